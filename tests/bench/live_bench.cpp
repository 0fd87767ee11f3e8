// SPDX-License-Identifier: GPL-3.0-or-later
// What a live page costs the loop: short runs at the pace of the wall clock, without a client, with clients
// that ask and stop reading, and with one that follows. Processor time of the loop's thread per frame, camera
// excluded.
//
// Watching changes nothing (LivePage.WatchingChangesNothing...), so the n-th cycle does the same work in
// every run: each is measured as its median over the rounds, and what is left of a busy machine is in the
// confidence interval.
#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <cstdio>
#include <functional>
#include <map>
#include <numeric>
#include <random>
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

test::LiveRunOutcome runWith(const std::string& clients, double seconds) {
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
  test::LiveRunOutcome outcome = run.run(fromSeconds(seconds));
  over = true;
  client.join();
  return outcome;
}

using Rounds = std::vector<std::vector<double>>;  // by round, then cycle; s

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Every cycle's cost, by these rounds.
std::vector<double> costs(const Rounds& rounds, const std::vector<std::size_t>& chosen) {
  std::vector<double> cycles(rounds.front().size());
  for (std::size_t i = 0; i < cycles.size(); ++i) {
    std::vector<double> seen;
    for (const std::size_t round : chosen) seen.push_back(rounds[round][i]);
    cycles[i] = median(std::move(seen));
  }
  return cycles;
}

std::vector<double> picked(const std::vector<double>& values, const std::vector<bool>& wanted) {
  std::vector<double> some;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (wanted[i]) some.push_back(values[i]);
  }
  return some;
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double p99(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() * 99 / 100];
}

/// Percent by which `of` costs more than `without`, with the 95 % interval by resampling rounds.
struct Excess {
  double percent, low, high;
};
Excess excess(const Rounds& of, const Rounds& without, const std::vector<bool>& wanted,
              const std::function<double(const std::vector<double>&)>& statistic) {
  std::vector<std::size_t> all(of.size());
  std::iota(all.begin(), all.end(), 0);
  const auto percent = [&](const std::vector<std::size_t>& chosen) {
    return 100 *
           (statistic(picked(costs(of, chosen), wanted)) / statistic(picked(costs(without, chosen), wanted)) -
            1);
  };
  std::mt19937 random(1);
  std::uniform_int_distribution<std::size_t> any(0, of.size() - 1);
  std::vector<double> draws;
  for (int draw = 0; draw < 400; ++draw) {
    std::vector<std::size_t> chosen(of.size());
    for (std::size_t& round : chosen) round = any(random);
    draws.push_back(percent(chosen));
  }
  std::sort(draws.begin(), draws.end());
  return {percent(all), draws[10], draws[389]};
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Measures what a live page costs the servo loop. Moves the simulated arm.", "live_bench");
  double seconds = 10.0;
  int rounds = 12;
  cli.add_option("--seconds", seconds, "Length of a run")->capture_default_str();
  cli.add_option("--rounds", rounds, "Runs of each kind")->capture_default_str()->check(CLI::Range(2, 1000));
  CLI11_PARSE(cli, argc, argv);
  std::array<std::string, 3> kinds = {"none", "stalled", "following"};
  std::map<std::string, Rounds> cycles_s;
  std::map<std::string, double> hand_over_s;
  for (int round = 0; round < rounds; ++round) {
    for (const std::string& clients : kinds) {
      test::LiveRunOutcome outcome = runWith(clients, seconds);
      hand_over_s[clients] += outcome.hand_over_s;
      cycles_s[clients].push_back(std::move(outcome.cycles_s));
    }
    std::reverse(kinds.begin(), kinds.end());  // What drifts with time meets all alike.
  }
  const Rounds& without = cycles_s["none"];
  const std::size_t count = without.front().size();
  for (const auto& [clients, runs] : cycles_s) {
    for (const std::vector<double>& run : runs) {
      if (run.size() == count) continue;
      std::fprintf(stderr, "runs differ: %zu cycles and %zu\n", count, run.size());
      return 1;
    }
  }
  std::vector<std::size_t> all(without.size());
  std::iota(all.begin(), all.end(), 0);
  const std::vector<double> usual = costs(without, all);
  std::vector<bool> every(count, true), plain(count);
  for (std::size_t i = 0; i < count; ++i)
    plain[i] = usual[i] < 3 * median(usual);  // the others hold an estimate
  std::printf("%-10s %-14s %7s %9s %9s   %-24s %s\n", "clients", "cycles", "count", "mean, ms", "p99, ms",
              "mean, % more", "p99, % more");
  for (const auto& [name, wanted] : {std::pair("plain", plain), std::pair("all", every)}) {
    for (const char* clients : {"none", "stalled", "following"}) {
      const std::vector<double> cost = picked(costs(cycles_s[clients], all), wanted);
      const Excess by_mean = excess(cycles_s[clients], without, wanted, mean);
      const Excess by_p99 = excess(cycles_s[clients], without, wanted, p99);
      std::printf("%-10s %-14s %7zu %9.3f %9.3f   %+5.1f (%+5.1f to %+5.1f)   %+5.1f (%+5.1f to %+5.1f)\n",
                  clients, name, cost.size(), mean(cost) * 1e3, p99(cost) * 1e3, by_mean.percent, by_mean.low,
                  by_mean.high, by_p99.percent, by_p99.low, by_p99.high);
    }
  }
  // What the loop itself does for the page; the rest of a difference is two threads on the same caches and
  // memory.
  for (const auto& [clients, total_s] : hand_over_s) {
    std::printf("%-10s hands over in %.1f us per cycle\n", clients.c_str(),
                1e6 * total_s / static_cast<double>(count * without.size()));
  }
  return 0;
}
