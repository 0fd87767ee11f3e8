// SPDX-License-Identifier: GPL-3.0-or-later
// What makes the guard stop the arm, and what it tells of it. Rules twice: with them, and without (the
// negative control).
#include <gtest/gtest.h>

#include <limits>
#include <thread>

#include "guard_cell.h"
#include "servocal/core/error.h"

namespace servocal::robot {
namespace {

using test::FakeArm;
using test::FakeArmOptions;

TEST(Guard, StopsAtOnceOnAStaleFrame) {
  const auto moveThenOld = [](Cell& cell) {
    for (int i = 0; i < 50; ++i) {
      cell.guard->command(kUp, cell.clock.now() - fromSeconds(0.08));
      cell.clock.sleepFor(fromSeconds(0.008));
    }
    return cell.guard->command(kUp, cell.clock.now() - fromSeconds(0.16));
  };
  Cell cell;
  const GuardVerdict verdict = moveThenOld(cell);
  EXPECT_EQ(verdict.rule, GuardRule::kStaleFrame);
  EXPECT_TRUE(verdict.refused());
  EXPECT_TRUE(cell.arm.log().back().stop);
  EXPECT_EQ(cell.guard->command(kUp, cell.clock.now() + fromSeconds(0.01)).rule, GuardRule::kStaleFrame);

  GuardOptions without;
  without.max_frame_age = std::chrono::hours(1);
  Cell control(openLimits(), without);
  EXPECT_FALSE(moveThenOld(control).refused());
  EXPECT_FALSE(control.arm.log().back().stop);
}

// The program may die after its last command: what rests on a frame ends with that frame.
TEST(Guard, CommandsExpireWithTheFrameTheyRestOn) {
  Cell cell;
  cell.clock.sleepFor(fromSeconds(0.2));
  cell.guard->command(kUp, cell.clock.now() - fromSeconds(0.1));
  EXPECT_EQ(cell.arm.log().back().valid_for, fromSeconds(0.05));
  cell.guard->command(kUp);
  EXPECT_EQ(cell.arm.log().back().valid_for, fromSeconds(0.1));
}

TEST(Guard, RefusesNumbersThatAreNotFinite) {
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    Cell cell;
    cell.hold(kUp, 0.2);
    Twist<Base> wanted = kUp;
    wanted.angular_radps.y() = bad;
    const GuardVerdict verdict = cell.guard->command(wanted);
    EXPECT_EQ(verdict.rule, GuardRule::kNonFinite);
    EXPECT_TRUE(verdict.refused());
    EXPECT_TRUE(cell.arm.log().back().stop);
    for (const FakeArm::Command& command : cell.arm.log()) EXPECT_TRUE(command.twist.isFinite());
    EXPECT_FALSE(cell.hold(kUp, 0.1).refused());  // The same without the bad number.
  }
  Cell cell;
  cell.arm.corrupt = true;
  cell.hold(kUp, 0.05);
  EXPECT_EQ(cell.guard->command(kUp).rule, GuardRule::kNonFinite);
  EXPECT_TRUE(cell.arm.log().back().stop);
}

TEST(Guard, ArmBrakesByItselfWhenCommandsCease) {
  const auto travelInSilence = [](Cell& cell) {
    cell.hold({{0, 0, 0.05}, {0, 0, 0}}, 0.3);
    const double before = cell.z();
    cell.clock.sleepFor(fromSeconds(2.0));
    return cell.z() - before;
  };
  Cell cell;
  EXPECT_LT(travelInSilence(cell), 0.05 * 0.1 + 0.05 * 0.05 / 2.4 + 0.001);
  const GuardVerdict verdict = cell.guard->command(kUp);
  EXPECT_EQ(verdict.rule, GuardRule::kWatchdog) << verdict.reason;
  EXPECT_LE(verdict.applied.linear_mps.norm(), 1.2 * 0.008 * (1 + 1e-9));  // From rest again.

  GuardOptions without;
  without.command_timeout = without.look_ahead = std::chrono::seconds(3);
  Cell control(openLimits(), without);
  EXPECT_GT(travelInSilence(control), 0.08);
}

// For those who watch: what was asked for, what came of it, and how often it was not the same.
TEST(Guard, KeepsARecordOfItsVerdicts) {
  Cell cell;
  EXPECT_FALSE(cell.guard->record().at);
  cell.hold(kUp, 0.4);
  const GuardRecord& record = cell.guard->record();
  EXPECT_EQ(record.newest.wanted.linear_mps.z(), kUp.linear_mps.z());
  EXPECT_GT(record.interventions.at(GuardRule::kAcceleration), 3);
  EXPECT_FALSE(record.refused_at);
  Twist<Base> bad = kUp;
  bad.linear_mps.x() = std::numeric_limits<double>::infinity();
  cell.guard->command(bad);
  EXPECT_EQ(record.at, cell.clock.now());
  EXPECT_EQ(record.refused_at, cell.clock.now());
  EXPECT_EQ(record.newest.rule, GuardRule::kNonFinite);
  EXPECT_TRUE(record.newest.wanted.isZero());
  // Joint speeds count as the twist they would make.
  const Instant refused_at = cell.clock.now();
  cell.clock.sleepFor(fromSeconds(0.5));
  const Eigen::VectorXd turning = Eigen::VectorXd::Constant(cell.guard->kinematics().joints(), 0.01);
  const GuardVerdict verdict = cell.guard->commandJoints(turning);
  const Eigen::VectorXd twist = cell.guard->kinematics().jacobian(cell.guard->state().q) * turning;
  EXPECT_NEAR((record.newest.wanted.linear_mps - twist.head<3>()).norm(), 0.0, 1e-12);
  EXPECT_EQ(record.newest.rule, verdict.rule);
  EXPECT_EQ(record.refused_at, refused_at);
  // After a stop nothing is wanted.
  cell.guard->stopNow();
  EXPECT_TRUE(record.newest.wanted.isZero());
  EXPECT_EQ(record.newest.rule, GuardRule::kNone);
}

TEST(Guard, OperatorStopIsImmediateAndLatched) {
  Cell cell;
  cell.hold(kUp, 0.3);
  EXPECT_FALSE(cell.guard->command(kUp).refused());  // The control: it does move.
  std::thread([&] { cell.guard->operatorStop(); }).join();
  for (int i = 0; i < 3; ++i) {
    const GuardVerdict verdict = cell.guard->command(kUp);
    EXPECT_EQ(verdict.rule, GuardRule::kOperatorStop);
    EXPECT_TRUE(cell.arm.log().back().stop);
    cell.clock.sleepFor(fromSeconds(1.0));
  }
  cell.guard->stopAndWait();
  EXPECT_TRUE(cell.arm.state().twist.isZero());
}

TEST(Guard, DestructorStopsTheArm) {
  Cell cell;
  cell.hold(kUp, 0.3);
  ASSERT_FALSE(cell.arm.log().back().stop);
  cell.guard.reset();
  EXPECT_TRUE(cell.arm.log().back().stop);
}

TEST(Guard, StopAndWaitBrakesWithinLimitsAndEndsAtRest) {
  Cell cell;
  cell.hold({{0.25, 0, 0}, {0, 0, 0}}, 0.5);
  const Instant before = cell.clock.now();
  cell.guard->stopAndWait();
  EXPECT_TRUE(cell.arm.state().twist.isZero());
  EXPECT_LT(toSeconds(cell.clock.now() - before), 0.3);
  EXPECT_LE(largestAcceleration(cell.arm), 1.2 * (1 + 1e-6));
}

TEST(Guard, StopAndWaitSaysSoIfTheArmDoesNotStop) {
  FakeArmOptions runaway;
  runaway.stop_factor = 1e-6;
  Cell cell(openLimits(), {}, {}, {}, runaway);
  cell.hold({{0.1, 0, 0}, {0, 0, 0}}, 0.2);
  cell.guard->stopNow();
  try {
    cell.guard->stopAndWait();
    FAIL() << "claims to stand";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kSafetyStop);
  }
}

TEST(Guard, RemembersFirstAndLastMotion) {
  Cell cell;
  cell.clock.sleepFor(fromSeconds(1.0));
  cell.hold({}, 0.5);
  EXPECT_FALSE(cell.guard->motionSpan());
  cell.hold(kUp, 0.5);
  cell.hold({}, 3.0);
  ASSERT_TRUE(cell.guard->motionSpan());
  EXPECT_NEAR(toSeconds(cell.guard->motionSpan()->first), 1.504, 0.01);
  EXPECT_NEAR(toSeconds(cell.guard->motionSpan()->second), 2.0 + 0.17, 0.02);
}

}  // namespace
}  // namespace servocal::robot
