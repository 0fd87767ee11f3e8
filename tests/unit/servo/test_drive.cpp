// SPDX-License-Identifier: GPL-3.0-or-later
// The closed loop: true points through a true camera, 65 ms late, 30 Hz, 0.1 px noise, a kinematic arm.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "servo_bench.h"

namespace servocal::servo {
namespace {

using test::Bench;
using test::BenchOptions;
using test::kDegree;

BenchOptions seeded(unsigned seed, double lag_s = 0.02) {
  BenchOptions options;
  options.observer.seed = seed;
  options.arm.lag_s = lag_s;
  return options;
}

Eigen::Vector3d ofLength(std::mt19937_64& random, double length) {
  return length * test::randomVector(random, 1.0).normalized();
}

struct Watch {
  explicit Watch(Bench& bench) {
    bench.arm.on_step = [this, &bench](const RobotState& state) {
      border_px = std::min(border_px, bench.borderPx(state.bMe));
    };
  }
  double border_px = 1e9;  ///< Nearest any true point came to the image border.
};

double rmsPx(Bench& bench, const Pose<Color, Board>& cdMo) {
  double sum = 0;
  for (const Eigen::Vector3d& point_o : bench.points_o)
    sum += (*bench.camera.project(bench.cMo() * point_o) - *bench.believed.project(cdMo * point_o)).squaredNorm();
  return std::sqrt(sum / static_cast<double>(bench.points_o.size()));
}

// Chain A, the mount wrong by up to 30 degrees and 50 mm, no camera pose: every goal is met, in view.
TEST(Drive, ConvergesWithAWrongMount) {
  double slowest = 0;
  for (unsigned seed = 1; seed <= 24; ++seed) {
    Bench bench(seeded(seed));
    std::mt19937_64 random(seed);
    const Pose<Color, Board> cdMo = bench.randomView(random);
    CellEstimate cell = bench.truth(false);
    const double angle = 30 * kDegree * (seed % 4) / 3.0;
    cell.eMo = bench.eMo * Pose<Board, Board>::fromRotationVector(ofLength(random, angle), ofLength(random, 0.05));
    Watch watch(bench);
    const DriveOutcome outcome = bench.drive(cdMo, cell);
    EXPECT_EQ(outcome.status, DriveStatus::kReached) << "seed " << seed << ": " << outcome.reason;
    EXPECT_EQ(outcome.losses, 0) << seed;
    EXPECT_LT(rmsPx(bench, cdMo), 1.0) << seed;
    EXPECT_GT(watch.border_px, 20.0) << seed;
    EXPECT_TRUE(bench.arm.state().twist.isZero());
    slowest = std::max(slowest, toSeconds(outcome.elapsed));
  }
  std::printf("wrong mount, 24 drives: slowest %.2f s\n", slowest);
  EXPECT_LT(slowest, 8.0);
}

// 5 % wrong focal length and no distortion: the pixels are met as far as a plane can; never a hang.
TEST(Drive, SettlesWithWrongIntrinsics) {
  int reached = 0;
  double slowest = 0, worst = 0;
  for (unsigned seed = 1; seed <= 16; ++seed) {
    BenchOptions options = seeded(seed);
    options.focal_error = seed % 2 ? 0.05 : -0.05;
    options.ignore_distortion = true;
    Bench bench(options);
    std::mt19937_64 random(seed);
    const Pose<Color, Board> cdMo = bench.randomView(random, 30 * kDegree, 80.0);
    const DriveOutcome outcome = bench.drive(cdMo, bench.truth(seed % 3 == 0));
    EXPECT_TRUE(outcome.status == DriveStatus::kReached || outcome.status == DriveStatus::kPlateau) << seed << outcome.reason;
    EXPECT_EQ(outcome.status == DriveStatus::kReached, outcome.error_px <= 3.0);
    reached += outcome.status == DriveStatus::kReached;
    slowest = std::max(slowest, toSeconds(outcome.elapsed));
    worst = std::max(worst, outcome.error_px);
  }
  std::printf("wrong intrinsics, 16 drives: %d reached, worst %.1f px, slowest %.2f s\n", reached, worst, slowest);
  EXPECT_GE(reached, 12);
  EXPECT_LT(slowest, 8.0);
}

// Feed-forward with the camera pose wrong by 3 degrees and 30 mm: the image closes the rest.
TEST(Drive, ConvergesWithAWrongCameraPose) {
  double slowest = 0;
  for (unsigned seed = 1; seed <= 16; ++seed) {
    Bench bench(seeded(seed));
    std::mt19937_64 random(seed);
    const Pose<Color, Board> cdMo = bench.randomView(random, 30 * kDegree, 60.0);
    CellEstimate cell = bench.truth(true);
    cell.bMc = *cell.bMc * Pose<Color, Color>::fromRotationVector(ofLength(random, 3 * kDegree), ofLength(random, 0.03));
    Watch watch(bench);
    const DriveOutcome outcome = bench.drive(cdMo, cell);
    EXPECT_EQ(outcome.status, DriveStatus::kReached) << "seed " << seed << ": " << outcome.reason;
    EXPECT_LT(rmsPx(bench, cdMo), 1.0) << seed;
    EXPECT_GT(watch.border_px, 20.0) << seed;
    slowest = std::max(slowest, toSeconds(outcome.elapsed));
  }
  std::printf("wrong camera pose, 16 drives: slowest %.2f s\n", slowest);
}

// The time budget: 150 mm and 20 degrees at the default caps, settling included.
TEST(Drive, TypicalStepTakesLessThanTwoAndAHalfSeconds) {
  for (const bool known : {true, false}) {
    std::vector<double> times;
    for (unsigned seed = 1; seed <= 16; ++seed) {
      Bench bench(seeded(seed, 0.03));
      std::mt19937_64 random(seed);
      const Pose<Color, Board> cdMo = Bench::view(Eigen::Vector3d(0, 0, 0.6) + ofLength(random, 0.15), ofLength(random, 20 * kDegree));
      const DriveOutcome outcome = bench.drive(cdMo, bench.truth(known));
      EXPECT_EQ(outcome.status, DriveStatus::kReached) << seed << outcome.reason;
      EXPECT_LT(toSeconds(outcome.elapsed), 2.5) << seed;
      times.push_back(toSeconds(outcome.elapsed));
      // At rest, and it stays at rest: nothing swings on.
      const Pose<Base, EndEffector> end = bench.arm.state().bMe;
      bench.clock.sleepFor(std::chrono::seconds(1));
      EXPECT_LT(distanceM(end, bench.arm.state().bMe), 1e-4);
    }
    std::sort(times.begin(), times.end());
    std::printf("150 mm and 20 degrees, camera pose %s: median %.2f s, slowest %.2f s\n", known ? "known" : "unknown",
                times[times.size() / 2], times.back());
  }
}

// Reversals of the commanded motion near the goal, the mark of a loop that rings.
int reversals(const test::FakeArm& arm) {
  int count = 0;
  Eigen::Vector3d last = Eigen::Vector3d::Zero();
  for (const auto& command : arm.log()) {
    const Eigen::Vector3d v = command.twist.linear_mps;
    if (v.norm() < 0.004) continue;
    if (last.dot(v) < -0.5 * last.norm() * v.norm()) ++count;
    last = v;
  }
  return count;
}

// Latency and lag: the default gain has a margin of more than two, with the mount 30 degrees wrong.
TEST(Drive, IsStableWithLatencyAndAWrongMount) {
  for (const double latency_s : {0.035, 0.065, 0.09}) {
    for (const double gain : {5.0, 10.0}) {
      int rung = 0;
      double slowest = 0;
      for (unsigned seed = 1; seed <= 6; ++seed) {
        BenchOptions options = seeded(seed, 0.03);
        options.observer.latency_s = latency_s;
        Bench bench(options);
        std::mt19937_64 random(seed);
        CellEstimate cell = bench.truth(false);
        cell.eMo = bench.eMo * Pose<Board, Board>::fromRotationVector(ofLength(random, 30 * kDegree), ofLength(random, 0.05));
        const Pose<Color, Board> cdMo = bench.randomView(random, 20 * kDegree, 80.0);
        DriveOptions drive_options;
        drive_options.gain = gain;
        const DriveOutcome outcome = bench.drive(cdMo, cell, drive_options);
        EXPECT_EQ(outcome.status, DriveStatus::kReached) << seed << outcome.reason;
        rung = std::max(rung, reversals(bench.arm));
        slowest = std::max(slowest, toSeconds(outcome.elapsed));
      }
      std::printf("latency %.0f ms, gain %.0f: at most %d reversals, slowest %.2f s\n", 1e3 * latency_s, gain, rung, slowest);
      EXPECT_LE(rung, 2);
    }
  }
}

// Negative control: without accounting for the latency (stamps claim to be fresh) the same loop rings.
TEST(Drive, RingsIfTheLatencyIsHidden) {
  int rung = 0;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    BenchOptions options = seeded(seed, 0.03);
    options.observer.latency_s = 0.09;
    Bench bench(options);
    bench.observer.stamp_error = std::chrono::milliseconds(89);
    std::mt19937_64 random(seed);
    DriveOptions drive_options;
    drive_options.gain = 10.0;
    drive_options.timeout = std::chrono::seconds(5);
    (void)bench.drive(bench.randomView(random, 20 * kDegree, 150.0), bench.truth(false), drive_options);
    rung = std::max(rung, reversals(bench.arm));
  }
  EXPECT_GT(rung, 3);
}

// From a corner of the image to the opposite tilt: points slide along the margin.
TEST(Drive, ObeysTheImageBorderEveryCycle) {
  double least = 1e9;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    Bench bench(seeded(seed));
    std::mt19937_64 random(100 + seed);
    CellEstimate cell = bench.truth(false);
    // Next to the border first, then along it.
    DriveOptions options;
    for (int leg = 0; leg < 2; ++leg) {
      Pose<Color, Board> cdMo = bench.randomView(random, 30 * kDegree, 26.0);
      for (int i = 0; i < 200 && bench.borderPx(bench.flangeFor(cdMo)) > 45.0; ++i) cdMo = bench.randomView(random, 30 * kDegree, 26.0);
      Watch watch(bench);
      const DriveOutcome outcome = bench.drive(cdMo, cell, options);
      EXPECT_TRUE(outcome.status == DriveStatus::kReached || outcome.status == DriveStatus::kPlateau) << seed << outcome.reason;
      least = std::min(least, watch.border_px);
    }
  }
  std::printf("nearest to the border: %.1f px, margin 25 px\n", least);
  EXPECT_GT(least, 23.0);
}

TEST(MoveTo, GoesStraightAndEndsAtRest) {
  Bench bench(seeded(1, 0.03));
  const Pose<Base, EndEffector> goal = bench.flangeFor(Bench::view({0.08, -0.05, 0.55}, {0.2, -0.1, 0.3}));
  const DriveOutcome outcome = moveTo(*bench.guard, bench.clock, goal);
  EXPECT_EQ(outcome.status, DriveStatus::kReached) << outcome.reason;
  EXPECT_LT(distanceM(bench.arm.state().bMe, goal), 0.0005);
  EXPECT_LT(angleRad(bench.arm.state().bMe, goal), 0.001);
  EXPECT_TRUE(bench.arm.state().twist.isZero());
  EXPECT_LT(toSeconds(outcome.elapsed), 1.6);
}

}  // namespace
}  // namespace servocal::servo
