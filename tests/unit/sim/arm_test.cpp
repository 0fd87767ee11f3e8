// SPDX-License-Identifier: GPL-3.0-or-later
// The simulated arm through its public interface.
#include <gtest/gtest.h>

#include "default_sim.h"
#include "motion_key.h"
#include "servocal/core/error.h"
#include "sim_truth.h"
#include "ur5.h"

namespace servocal::sim {
namespace {

using std::chrono::milliseconds;

class SimulatedArmTest : public ::testing::Test {
 protected:
  void move(const Twist<Base>& twist, Duration valid_for = milliseconds(100)) {
    cell.arm().move(test::forgedMotionKey(), twist, valid_for);
  }
  /// Renews the command every 20 ms for `duration`, as a control loop does.
  void drive(const Twist<Base>& twist, Duration duration) {
    for (Duration t{}; t < duration; t += milliseconds(20)) {
      move(twist);
      cell.clock().sleepFor(milliseconds(20));
    }
  }
  Vector6d speedAt(Instant instant) const {  // By differences over one 2 ms tick.
    return (truth.q(instant) - truth.q(instant - milliseconds(2))) / 0.002;
  }

  CellConfig config = test::defaultSimCell();
  Cell cell{config, 1};
  Truth truth{cell};
};

Twist<Base> linear(double x, double y, double z) { return {{x, y, z}, Eigen::Vector3d::Zero()}; }

TEST_F(SimulatedArmTest, StartsAtTheConfiguredJointsAndReportsNominalKinematics) {
  const RobotState state = cell.arm().state();
  EXPECT_LT((state.q - config.arm.start_q).norm(), 1e-4);
  EXPECT_LT((state.bMe.isometry().matrix() - Ur5().forward(state.q).matrix()).norm(), 1e-12);
  EXPECT_TRUE(state.twist.isZero());
  // The truth is near, but not what is reported.
  EXPECT_LT(distanceM(state.bMe, truth.bMe()), 2e-3);
  EXPECT_GT(distanceM(state.bMe, truth.bMe()), 1e-5);
}

TEST_F(SimulatedArmTest, FollowsTheTwist) {
  const Pose<Base, EndEffector> before = truth.bMe();
  drive(linear(0.0, 0.05, -0.02), milliseconds(1000));
  const RobotState state = cell.arm().state();
  EXPECT_LT((state.twist.linear_mps - Eigen::Vector3d(0.0, 0.05, -0.02)).norm(), 1e-3);
  EXPECT_LT(state.twist.angular_radps.norm(), 1e-3);
  const Eigen::Vector3d moved = truth.bMe().translation() - before.translation();
  EXPECT_LT((moved - Eigen::Vector3d(0.0, 0.05, -0.02)).norm(), 2e-3);
}

TEST_F(SimulatedArmTest, TurnsAboutTheBasesAxes) {
  const Eigen::Matrix3d before = truth.bMe().rotation();
  drive({Eigen::Vector3d::Zero(), {0.0, 0.0, 0.3}}, milliseconds(1000));
  const Eigen::AngleAxisd turned(truth.bMe().rotation() * before.transpose());
  EXPECT_NEAR(turned.angle(), 0.3, 0.01);
  EXPECT_GT(turned.axis().z(), 0.999);
}

TEST_F(SimulatedArmTest, BrakesWhenCommandsCease) {
  move(linear(0.0, 0.2, 0.0), milliseconds(100));
  cell.clock().sleepFor(milliseconds(90));
  EXPECT_GT(cell.arm().state().twist.linear_mps.norm(), 0.19);
  cell.clock().sleepFor(milliseconds(90));
  const Pose<Base, EndEffector> stopped = truth.bMe();
  EXPECT_TRUE(cell.arm().state().twist.isZero());
  cell.clock().sleepFor(milliseconds(1000));
  EXPECT_EQ(distanceM(stopped, truth.bMe()), 0.0);
}

TEST_F(SimulatedArmTest, StopEndsACommand) {
  move(linear(0.0, 0.2, 0.0), std::chrono::seconds(10));
  cell.clock().sleepFor(milliseconds(500));
  cell.arm().stop(test::forgedMotionKey());
  cell.clock().sleepFor(milliseconds(200));
  EXPECT_TRUE(cell.arm().state().twist.isZero());
}

TEST_F(SimulatedArmTest, RespectsSpeedAndAccelerationLimitsAndKeepsTheDirection) {
  const Instant start = cell.clock().now();
  move(linear(0.0, 3.0, 0.0), milliseconds(300));
  cell.clock().sleepFor(milliseconds(600));
  double fastest = 0.0, hardest = 0.0;
  for (Instant t = start + milliseconds(4); t < start + milliseconds(600); t += milliseconds(2)) {
    fastest = std::max(fastest, speedAt(t).cwiseAbs().maxCoeff());
    hardest = std::max(hardest, (speedAt(t) - speedAt(t - milliseconds(2))).cwiseAbs().maxCoeff() / 0.002);
  }
  EXPECT_LE(fastest, config.simulation->max_joint_speed_radps * (1 + 1e-9));
  EXPECT_GT(fastest, 0.99 * config.simulation->max_joint_speed_radps);  // It was tried.
  EXPECT_LE(hardest, config.simulation->max_joint_acceleration_radps2 * (1 + 1e-6));
  EXPECT_GT(hardest, 0.5 * config.simulation->max_joint_acceleration_radps2);
  const Vector6d twist =
      Ur5().jacobian(truth.q(start + milliseconds(60))) * speedAt(start + milliseconds(60));
  EXPECT_GT(twist[1] / twist.norm(), 0.99);
}

TEST_F(SimulatedArmTest, StaysFiniteAndWithinLimitsThroughASingularity) {
  const Instant start = cell.clock().now();
  drive(linear(0.25, 0.0, 0.1), milliseconds(2900));  // Out of reach: the elbow stretches.
  for (Instant t = start + milliseconds(2); t < cell.clock().now(); t += milliseconds(2)) {
    ASSERT_TRUE(truth.q(t).allFinite());
    EXPECT_LE(speedAt(t).cwiseAbs().maxCoeff(), config.simulation->max_joint_speed_radps * (1 + 1e-9));
  }
  EXPECT_LT(std::abs(std::sin(truth.q()[2])), 0.2);
}

TEST_F(SimulatedArmTest, JointLimitIsAProtectiveStop) {
  const Eigen::Vector3d tool_axis = truth.bMe().rotation().col(2);
  drive({Eigen::Vector3d::Zero(), 2.5 * tool_axis}, milliseconds(2000));
  EXPECT_NO_THROW(cell.arm().state());
  drive({Eigen::Vector3d::Zero(), 2.5 * tool_axis}, milliseconds(2000));
  EXPECT_LE(std::abs(truth.q()[5]), 2 * M_PI);
  const Pose<Base, EndEffector> stopped = truth.bMe();
  try {
    cell.arm().state();
    FAIL() << "no protective stop";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kSafetyStop);
    EXPECT_NE(std::string(error.what()).find("joint 6"), std::string::npos) << error.what();
  }
  // It does not reset itself.
  drive(linear(0.0, 0.1, 0.0), milliseconds(200));
  EXPECT_EQ(distanceM(stopped, truth.bMe()), 0.0);
  EXPECT_THROW(cell.arm().state(), Error);
}

TEST_F(SimulatedArmTest, ReadingTheStateTakesNoTimeAndChangesNothing) {
  Cell other(config, 1);
  for (int i = 0; i < 20; ++i) {
    move(linear(0.0, 0.1, 0.0));
    other.arm().move(test::forgedMotionKey(), linear(0.0, 0.1, 0.0), milliseconds(100));
    const Instant before = cell.clock().now();
    cell.arm().state();
    cell.arm().state();
    EXPECT_EQ(cell.clock().now(), before);
    cell.clock().sleepFor(milliseconds(33));
    other.clock().sleepFor(milliseconds(33));
  }
  EXPECT_EQ(cell.arm().state().q, other.arm().state().q);
}

TEST_F(SimulatedArmTest, InterpolatesThePast) {
  drive(linear(0.0, 0.2, 0.0), milliseconds(2500));
  const Instant now = cell.clock().now();
  for (const int age_ms : {11, 333, 1001, 1999}) {
    const Instant then = now - milliseconds(age_ms);
    const RobotState state = cell.arm().stateAt(then);
    EXPECT_EQ(state.stamp, then);
    EXPECT_LT((state.q - truth.q(then)).norm(), 1e-4) << age_ms;
    // 8 ms earlier is another place: the measure would see a wrong stamp.
    EXPECT_GT((state.q - truth.q(then - milliseconds(8))).norm(), 5e-4) << age_ms;
  }
  EXPECT_EQ(cell.arm().stateAt(now + milliseconds(500)).stamp, cell.arm().state().stamp);
}

TEST_F(SimulatedArmTest, RefusesATwistThatIsNotANumber) {
  EXPECT_THROW(move(linear(std::nan(""), 0.0, 0.0)), std::invalid_argument);
}

TEST(SimulatedArm, RefusesAStartBeyondTheJointLimits) {
  CellConfig config = test::defaultSimCell();
  config.arm.start_q[3] = 7.0;
  EXPECT_THROW(Cell(config, 1), std::invalid_argument);
  config.arm.start_q.resize(0);
  EXPECT_THROW(Cell(config, 1), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::sim
