// SPDX-License-Identifier: GPL-3.0-or-later
// What a live page costs the loop: runs at the pace of the wall clock, in turn without a client, with clients
// that ask and stop reading, and with one that follows. Processor time of the loop's thread per frame, camera
// excluded.
#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <map>
#include <numeric>
#include <string>
#include <thread>

#include "cells.h"
#include "live_run.h"
#include "temporary_folder.h"

namespace {

using namespace servocal;

/// A connection on which `path` was asked for.
int ask(const std::string& url, const std::string& path) {
  const std::size_t port_at = url.find(':', 7) + 1, token_at = url.find("token=") + 6;
  const int connection = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(url.substr(port_at))));
  inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
  const std::string request = "GET " + path +
                              " HTTP/1.1\r\nHost: localhost\r\nX-Servocal-Token: " + url.substr(token_at) +
                              "\r\n\r\n";
  if (connect(connection, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
      write(connection, request.data(), request.size()) < 0) {
    close(connection);
    return -1;
  }
  return connection;
}

void readAll(int connection) {
  char buffer[65536];
  while (connection >= 0 && read(connection, buffer, sizeof buffer) > 0) {
  }
}

std::vector<double> cyclesOf(const std::string& clients, double seconds) {
  const test::TemporaryFolder folder;
  test::LiveRun run(test::oneCameraCell(), folder / "session");
  std::atomic<bool> over{false};
  std::thread client([&] {
    std::vector<int> open;
    while (clients != "none" && !over) {
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
      for (const char* path : {"/state", "/look?camera=cam1&stream=color"}) {
        if (clients == "stalled" && open.size() >= 16) break;
        open.push_back(ask(run.url(), path));
        if (clients == "following") readAll(open.back());
      }
    }
    for (const int connection : open) close(connection);
  });
  const test::LiveRunOutcome outcome = run.run(fromSeconds(seconds));
  over = true;
  client.join();
  return outcome.cycles_s;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Measures what a live page costs the servo loop. Moves the simulated arm.", "live_bench");
  double seconds = 25.0;
  int rounds = 2;
  cli.add_option("--seconds", seconds, "Length of a run")->capture_default_str();
  cli.add_option("--rounds", rounds, "Runs of each kind")->capture_default_str();
  CLI11_PARSE(cli, argc, argv);
  std::map<std::string, std::vector<double>> cycles_s;
  for (int round = 0; round < rounds; ++round) {
    for (const char* clients : {"none", "stalled", "following"}) {
      const std::vector<double> more = cyclesOf(clients, seconds);
      cycles_s[clients].insert(cycles_s[clients].end(), more.begin(), more.end());
    }
  }
  std::printf("%-10s %8s %12s %12s\n", "clients", "cycles", "mean, ms", "p99, ms");
  for (const char* clients : {"none", "stalled", "following"}) {
    std::vector<double>& cycles = cycles_s[clients];
    const double mean_s =
        std::accumulate(cycles.begin(), cycles.end(), 0.0) / static_cast<double>(cycles.size());
    std::sort(cycles.begin(), cycles.end());
    std::printf("%-10s %8zu %12.3f %12.3f\n", clients, cycles.size(), mean_s * 1e3,
                cycles[cycles.size() * 99 / 100] * 1e3);
  }
  return 0;
}
