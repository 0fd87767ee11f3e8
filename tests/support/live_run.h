// SPDX-License-Identifier: GPL-3.0-or-later
// A calibration of a simulated cell at the pace of the wall clock, shown on a live page.
#pragma once

#include <time.h>

#include <atomic>
#include <chrono>
#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "servocal/core/error.h"
#include "servocal/live/server.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/robot/guard.h"
#include "servocal/session/session.h"
#include "servocal/sim/cell.h"

namespace servocal::test {

using Steady = std::chrono::steady_clock;

/// Holds simulated time back until the wall clock has come as far, and keeps the books of the loop: what it
/// computed from one frame to the next.
class Pace {
 public:
  explicit Pace(Clock& simulated) : simulated_(simulated) {}

  void hold() {
    const auto due =
        begin_ + std::chrono::duration_cast<Steady::duration>(simulated_.now().time_since_epoch());
    if (Steady::now() < due) std::this_thread::sleep_until(due);
    last_held_ = simulated_.now();
  }
  void frameComes() {
    if (frame_left_s_) cycles_s.push_back(threadCpuS() - *frame_left_s_);
  }
  void frameLeaves() { frame_left_s_ = threadCpuS(); }
  Instant lastHeld() const { return last_held_; }

  static double threadCpuS() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }

  std::vector<double> cycles_s;  ///< Processor time of the loop's thread outside the camera, per frame.

 private:
  Clock& simulated_;
  Steady::time_point begin_ = Steady::now();
  Instant last_held_{};
  std::optional<double> frame_left_s_;
};

class PacedClock final : public Clock {
 public:
  PacedClock(Clock& simulated, Pace& pace) : simulated_(simulated), pace_(pace) {}
  Instant now() const override { return simulated_.now(); }
  void sleepUntil(Instant instant) override {
    simulated_.sleepUntil(instant);
    pace_.hold();
  }

 private:
  Clock& simulated_;
  Pace& pace_;
};

class PacedCamera final : public sensor::RgbdCamera {
 public:
  PacedCamera(sensor::RgbdCamera& simulated, Pace& pace) : simulated_(simulated), pace_(pace) {}
  const sensor::CameraInfo& info() const override { return simulated_.info(); }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override {
    pace_.frameComes();
    auto frame = simulated_.next(stream, deadline);
    pace_.hold();
    pace_.frameLeaves();
    return frame;
  }

 private:
  sensor::RgbdCamera& simulated_;
  Pace& pace_;
};

/// What became of a run that was stopped from the page, or after `length`.
struct LiveRunOutcome {
  std::vector<double> cycles_s;
  double hand_over_s = 0.0;  ///< Of all cycles together: what the loop spent in Server::show().
  std::optional<Steady::time_point> stop_heard;  ///< When the server was told to stop.
  double rest_after_s =
      0.0;  ///< Simulated time from then until the arm stood still, at most one cycle too long.
  bool interrupted = false;
};

class LiveRun {
 public:
  LiveRun(const CellConfig& cell, const std::filesystem::path& folder)
      : cell_(cell), simulation_(cell_, 1), kinematics_(cell_.arm), pace_(simulation_.clock()),
        clock_(simulation_.clock(), pace_), guard_(simulation_.arm(), kinematics_, clock_, cell_),
        session_(session::Session::create(folder, cell_.text, cell_.board, 1)),
        server_(cell_, [this] { hear(); }) {
    for (const CameraConfig& camera : cell_.cameras)
      cameras_.emplace_back(simulation_.camera(camera.name), pace_);
  }

  const std::string& url() const { return server_.url(); }

  /// Runs in the caller's thread until somebody stops it.
  LiveRunOutcome run(std::optional<Duration> length = std::nullopt) {
    LiveRunOutcome outcome;
    procedure::Devices devices{clock_, guard_, {}};
    for (PacedCamera& camera : cameras_) devices.cameras.push_back(&camera);
    Instant before_stop{};
    const auto watch = [&] {
      if (!guard_.operatorStopped()) before_stop = pace_.lastHeld();
      if (length && clock_.now() >= Instant(*length)) guard_.operatorStop();
    };
    const auto show = [&](const auto& what) {
      const double begin_s = Pace::threadCpuS();
      server_.show(what);
      outcome.hand_over_s += Pace::threadCpuS() - begin_s;
    };
    try {
      procedure::calibrate(
          cell_, devices, session_, [&](const procedure::Event& event) { show(event); }, {},
          [&](const procedure::Look& look) {
            watch();
            show(look);
          });
    } catch (const Error& error) {
      outcome.interrupted = error.kind() == ErrorKind::kInterrupted;
      while (!guard_.state().twist.isZero()) clock_.sleepFor(std::chrono::milliseconds(2));
      outcome.rest_after_s = toSeconds(clock_.now() - before_stop);
      server_.finish(false, error.what());
    }
    outcome.cycles_s = std::move(pace_.cycles_s);
    outcome.stop_heard = stop_heard_;
    return outcome;
  }

 private:
  void hear() {
    if (!stop_heard_) stop_heard_ = Steady::now();
    guard_.operatorStop();
  }

  CellConfig cell_;
  sim::Cell simulation_;
  robot::Kinematics kinematics_;
  Pace pace_;
  PacedClock clock_;
  robot::Guard guard_;
  std::deque<PacedCamera> cameras_;
  session::Session session_;
  std::optional<Steady::time_point> stop_heard_;  // Written by a thread of the server, read after finish().
  live::Server server_;
};

}  // namespace servocal::test
