// SPDX-License-Identifier: GPL-3.0-or-later
// The arm goes where it is told, in time, and no package is lost.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "servocal/robot/guard.h"
#include "servocal/servo/drive.h"
#include "ur_cell.h"

namespace servocal::robot::ur {
namespace {

using namespace test;

UrControllerOptions eSeries() {
  UrControllerOptions options;
  options.major = 5;
  options.minor = 11;
  return options;
}

TEST(UrMotion, ServoReachesAPoseThroughTheGuard) {
  UrControllerOptions options;
  options.tcp_offset.translation() = Eigen::Vector3d(0.02, 0.0, 0.1);
  for (const UrControllerOptions& series : {options, eSeries()}) {
    UrCell cell(series);
    const auto arm = cell.armed();
    const Kinematics kinematics(cell.config);
    GuardOptions guarded;  // A busy computer must not look like a dead program.
    guarded.command_timeout = std::chrono::milliseconds(300);
    guarded.look_ahead = std::chrono::milliseconds(350);
    Guard guard(*arm, kinematics, cell.clock, cell.limits, defaultCell().board, guarded);
    guard.setBoard(std::nullopt);
    const Pose<Base, EndEffector> start = arm->state().bMe;
    const Pose<Base, EndEffector> goal(
        Eigen::AngleAxisd(0.15, Eigen::Vector3d::UnitZ()).toRotationMatrix() * start.rotation(),
        start.translation() + Eigen::Vector3d(-0.04, 0.03, 0.05));
    const servo::DriveOutcome outcome = servo::moveTo(guard, cell.clock, goal);
    EXPECT_EQ(outcome.status, DriveStatus::kReached) << outcome.reason;
    const Pose<Base, EndEffector> truth(cell.controller.truth().flange);
    EXPECT_LT(distanceM(truth, goal), 0.001);
    EXPECT_LT(angleRad(truth, goal), 0.002);
  }
}

TEST(UrMotion, TwistIsTheFlangesThoughTheControllerMovesItsTcp) {
  UrControllerOptions options;
  options.tcp_offset.translation() = Eigen::Vector3d(0.0, 0.05, 0.2);
  UrCell cell(options);
  const auto arm = cell.armed();
  const Pose<Base, EndEffector> rest = arm->state().bMe;
  const Twist<Base> turn{Eigen::Vector3d::Zero(), {0.0, 0.0, 0.3}};
  const auto turned = [&](double angle_rad) { return angleRad(rest, arm->state().bMe) > angle_rad; };
  // While it speeds up, the controller ramps the two parts of the twist each for itself; the guard ramps both
  // slower.
  EXPECT_FALSE(cell.drive(*arm, turn, [&] { return turned(0.03); }));
  const Pose<Base, EndEffector> start(cell.controller.truth().flange);
  EXPECT_FALSE(cell.drive(*arm, turn, [&] { return turned(0.13); }));
  const Pose<Base, EndEffector> truth(cell.controller.truth().flange);
  EXPECT_GT(angleRad(start, truth), 0.08);
  EXPECT_LT(distanceM(start, truth), 0.001);  // The TCP went 20 mm.
  const RobotState state = arm->state();
  EXPECT_NEAR(state.twist.angular_radps.z(), 0.3, 0.01);
  EXPECT_LT(state.twist.linear_mps.norm(), 0.002);
}

TEST(UrMotion, JointSpeedsMoveTheJointAsked) {
  UrCell cell;
  const auto arm = cell.armed();
  const auto before = cell.controller.truth().q;
  Eigen::VectorXd speeds = Eigen::VectorXd::Zero(6);
  speeds[5] = 0.2;
  EXPECT_TRUE(cell.waitFor([&] {
    arm->moveJoints(forgedMotionKey(), speeds, std::chrono::milliseconds(400));
    return cell.controller.truth().q[5] - before[5] > 0.1;
  }));
  const auto after = cell.controller.truth().q;
  EXPECT_LT((after - before).head<5>().cwiseAbs().maxCoeff(), 1e-9);
  arm->stop(forgedMotionKey());
  EXPECT_TRUE(cell.waitFor([&] { return cell.stands(); }));
}

TEST(UrMotion, DestructorBrakesAndEndsTheProgram) {
  UrCell cell;
  auto arm = cell.armed();
  EXPECT_FALSE(cell.drive(*arm, UrCell::up(), [&] { return cell.moves(); }));
  arm.reset();
  const UrControllerTruth truth = cell.controller.truth();
  EXPECT_LT(truth.tcp_speed_mps, 0.001);
  EXPECT_FALSE(truth.program_runs);
  EXPECT_FALSE(truth.watchdog_struck);  // Heartbeats went on until it stood.
}

TEST(UrMotion, StatesOfThePastAreInterpolated) {
  UrCell cell;
  const auto arm = cell.armed();
  EXPECT_FALSE(cell.drive(*arm, UrCell::up(), [&] { return arm->report().states > 250; }));
  const RobotState now = arm->state();
  EXPECT_LE(now.stamp, cell.clock.now());
  const RobotState then = arm->stateAt(now.stamp - std::chrono::milliseconds(500));
  EXPECT_EQ(then.stamp, now.stamp - std::chrono::milliseconds(500));
  EXPECT_LT(then.bMe.translation().z(), now.bMe.translation().z());
  EXPECT_NEAR(now.device_stamp_s - then.device_stamp_s, 0.5,
              0.02 + 1e-3 * cell.controller.truth().late_steps * 8);
  EXPECT_EQ(arm->stateAt(now.stamp + std::chrono::seconds(5)).q.size(), 6);
}

/// How long after `start_s` (the controller's clock) the last input that asks for a motion came; the least of
/// a few tries, because a busy computer only ever adds to it.
template <class Try>
double leastOf(int tries, const Try& once) {
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < tries; ++i) least = std::min(least, once());
  return least;
}

TEST(UrTiming, CommandEndsWhenItsTimeIsUp) {
  UrCell cell;
  const auto arm = cell.armed();
  const double asked_for_s = leastOf(5, [&] {
    const double start_s = cell.controller.truth().time_s;
    arm->move(forgedMotionKey(), UrCell::up(), std::chrono::milliseconds(60));
    cell.clock.sleepFor(std::chrono::milliseconds(300));
    return cell.controller.truth().last_moving_input_s - start_s;
  });
  EXPECT_GT(asked_for_s, 0.030);
  EXPECT_LT(asked_for_s, 0.060 + 0.010);
  EXPECT_TRUE(cell.waitFor([&] { return cell.stands(); }));
  EXPECT_TRUE(arm->armed());
}

TEST(UrTiming, ZeroIsOnTheWireAtMost150MsAfterTheLastFrame) {
  UrCell cell;
  const auto arm = cell.armed();
  const Kinematics kinematics(cell.config);
  Guard guard(*arm, kinematics, cell.clock, cell.limits, defaultCell().board);
  guard.setBoard(std::nullopt);
  const double asked_for_s = leastOf(5, [&] {
    const double frame_s = cell.controller.truth().time_s;
    const Instant frame = cell.clock.now();
    cell.clock.sleepFor(std::chrono::milliseconds(70));  // Camera and detector.
    while (!guard.command(UrCell::up(), frame).refused()) cell.clock.sleepFor(std::chrono::milliseconds(8));
    cell.clock.sleepFor(std::chrono::milliseconds(100));
    return cell.controller.truth().last_moving_input_s - frame_s;
  });
  EXPECT_GT(asked_for_s, 0.080);
  EXPECT_LT(asked_for_s, 0.150 + 0.008);  // The truth is read in steps of 8 ms.
}

TEST(UrTiming, DeadControllerIsNoticedWithin100Ms) {
  const double silence_s = leastOf(5, [] {
    UrCell cell;
    const auto arm = cell.connected(ArmOptions());
    cell.clock.sleepFor(std::chrono::milliseconds(50));
    cell.controller.misbehave(UrFault::kSilent);
    if (!cell.waitFor([&] { return arm->report().silence.has_value(); }, 2.0)) return 10.0;
    return toSeconds(*arm->report().silence);
  });
  EXPECT_LT(silence_s, 0.100);
}

}  // namespace
}  // namespace servocal::robot::ur
