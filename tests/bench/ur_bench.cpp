// SPDX-License-Identifier: GPL-3.0-or-later
// The Universal Robots driver against the clock: packages beside a running vision loop, a dead controller,
// the last command after the last frame. Every try counts here, unlike in the tests, which take the least of
// several.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <thread>
#include <vector>

#include "board_picture.h"
#include "servocal/board/detector.h"
#include "servocal/robot/guard.h"
#include "ur_cell.h"

namespace {

using namespace servocal;
using std::chrono::milliseconds;
using test::UrCell;

sim::UrControllerOptions seriesOf(int rate_hz) {
  sim::UrControllerOptions options;
  if (rate_hz == 500) {  // e-Series
    options.major = 5;
    options.minor = 11;
  }
  return options;
}

/// Looks for the board in 1080p images, 30 times a second, while it lives.
class VisionLoop {
 public:
  VisionLoop() : thread_([this] { run(); }) {}
  ~VisionLoop() { (void)stop(); }
  /// Images looked at per second.
  double stop() {
    quit_ = true;
    if (thread_.joinable()) thread_.join();
    return looked_ / std::max(1e-3, toSeconds(clock_.now()));
  }

 private:
  void run() {
    test::PictureOptions options;
    options.width_px = 1920;
    options.height_px = 1080;
    options.centre_px = {960, 540};
    options.square_px = 60.0;
    const BoardSpec board;
    const cv::Mat image = test::renderPicture(board, options).gray;
    board::Detector detector(board);
    for (Instant due = clock_.now(); !quit_; due = std::max(due + milliseconds(33), clock_.now())) {
      (void)detector.detect(image);
      ++looked_;
      clock_.sleepUntil(due);
    }
  }
  WallClock clock_;
  std::atomic<bool> quit_{false};
  std::atomic<int> looked_{0};
  std::thread thread_;
};

void packages(int rate_hz, double seconds) {
  UrCell cell(seriesOf(rate_hz));
  const auto arm = cell.armed();
  VisionLoop vision;
  const robot::ur::LinkReport before = arm->report();
  const double start_s = cell.controller.truth().time_s;
  const std::size_t late_before = cell.controller.truth().late_steps;
  const auto error = cell.drive(
      *arm, {}, [] { return false; }, seconds);
  const double passed_s = cell.controller.truth().time_s - start_s;
  const double looked_hz = vision.stop();
  const robot::ur::LinkReport after = arm->report();
  std::printf("%7d %9.1f %9zu %7zu %9zu %15.1f %11zu %10.1f  %s\n", rate_hz, passed_s,
              after.states - before.states, after.missed, after.repeated, 1e3 * toSeconds(after.longest_gap),
              cell.controller.truth().late_steps - late_before, looked_hz, error ? error->what() : "");
}

void print(const char* what, std::vector<double> seconds, double limit_s) {
  std::sort(seconds.begin(), seconds.end());
  std::printf("%-44s %5zu %9.1f %9.1f %9.1f   %5.0f\n", what, seconds.size(), 1e3 * seconds.front(),
              1e3 * seconds[seconds.size() / 2], 1e3 * seconds.back(), 1e3 * limit_s);
}

void silence(int tries) {
  std::vector<double> all;
  for (int i = 0; i < tries; ++i) {
    UrCell cell;
    const auto arm = cell.connected(robot::ur::ArmOptions());
    cell.clock.sleepFor(milliseconds(100));
    cell.controller.misbehave(test::UrFault::kSilent);
    const bool noticed = cell.waitFor([&] { return arm->report().silence.has_value(); }, 5.0);
    all.push_back(noticed ? toSeconds(*arm->report().silence) : 5.0);
  }
  print("silence of the controller until it is noticed", all, 0.100);
}

void zero(int tries) {
  UrCell cell(seriesOf(500));  // Whose steps of 2 ms are how finely the truth is known.
  const auto arm = cell.armed();
  const robot::Kinematics kinematics(cell.config);
  robot::Guard guard(*arm, kinematics, cell.clock, cell.limits, defaultCell().board);
  guard.setBoard(std::nullopt);
  std::vector<double> all;
  for (int i = 0; i < tries; ++i) {
    const double frame_s = cell.controller.truth().time_s;
    const Instant frame = cell.clock.now();
    cell.clock.sleepFor(milliseconds(70));  // Camera and detector.
    while (!guard.command(UrCell::up(), frame).refused()) cell.clock.sleepFor(milliseconds(8));
    cell.clock.sleepFor(milliseconds(200));
    all.push_back(cell.controller.truth().last_moving_input_s - frame_s);
  }
  print("last frame to the last moving command", all, 0.150);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Packages, a dead controller and the last command of the Universal Robots driver.",
               "ur_bench");
  double seconds = 60.0;
  int tries = 20;
  cli.add_option("--seconds", seconds, "Of receiving at each rate")->capture_default_str();
  cli.add_option("--tries", tries, "Of each reaction")->capture_default_str();
  CLI11_PARSE(cli, argc, argv);
  std::printf("rate Hz         s    states  missed  repeated  longest gap ms  late steps  looked Hz\n");
  for (const int rate_hz : {125, 500}) packages(rate_hz, seconds);
  std::printf("%-44s %5s %9s %9s %9s   %5s\n", "reaction, ms", "tries", "least", "median", "most", "limit");
  silence(tries);
  zero(tries);
  double load[1] = {0.0};
  ::getloadavg(load, 1);
  std::printf("load of the computer %.1f\n", load[0]);
}
