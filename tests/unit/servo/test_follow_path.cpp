// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "fake_arm.h"
#include "servo_bench.h"
#include "servocal/servo/follow_path.h"
#include "temporary_folder.h"

namespace servocal::servo {
namespace {

using test::FakeArm;
using test::FakeArmOptions;

Eigen::VectorXd radians(std::initializer_list<double> degrees) {
  Eigen::VectorXd q(static_cast<Eigen::Index>(degrees.size()));
  std::copy(degrees.begin(), degrees.end(), q.begin());
  return q * test::kDegree;
}

double fromSegment(const Eigen::VectorXd& q, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  const double share = std::clamp((q - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
  return (q - a - share * (b - a)).norm();
}

double fromPath(const Eigen::VectorXd& q, const std::vector<Eigen::VectorXd>& path) {
  double least = 1e9;
  for (std::size_t i = 1; i < path.size(); ++i) least = std::min(least, fromSegment(q, path[i - 1], path[i]));
  return least;
}

class FollowPath : public ::testing::Test {
 protected:
  void start(const ArmConfig& config, const Eigen::VectorXd& q, double lag_s = 0.02) {
    guard.reset();  // It stops its arm.
    kinematics = std::make_unique<robot::Kinematics>(config);
    FakeArmOptions fake;
    fake.lag_s = lag_s;
    arm = std::make_unique<FakeArm>(*kinematics, clock, q, fake);
    CellConfig cell;
    cell.arm = config;
    cell.limits = test::cellLimits();
    cell.limits.keep_out = boxes;
    guard = std::make_unique<robot::Guard>(*arm, *kinematics, clock, cell);
    guard->setBoard(std::nullopt);
    arm->on_step = [this](const RobotState& state) {
      off = std::max(off, fromPath(state.q, path));
      fastest_joint =
          std::max(fastest_joint, last.size() ? (state.q - last).cwiseAbs().maxCoeff() / 0.002 : 0.0);
      last = state.q;
    };
  }
  DriveOutcome follow(const FollowOptions& options = {}) { return followPath(*guard, clock, path, options); }
  bool stands() {
    return arm->state().twist.linear_mps.norm() < 1e-3 && arm->state().twist.angular_radps.norm() < 3e-3;
  }

  SimulatedClock clock;
  std::vector<Box> boxes;
  std::unique_ptr<robot::Kinematics> kinematics;
  std::unique_ptr<FakeArm> arm;
  std::unique_ptr<robot::Guard> guard;
  std::vector<Eigen::VectorXd> path;
  Eigen::VectorXd last;
  double off = 0.0, fastest_joint = 0.0;
};

TEST_F(FollowPath, ReachesTheEndAndKeepsToThePath) {
  path = {radians({0, -100, -90, 10, 80, 0}), radians({40, -110, -80, 10, 80, 30}),
          radians({30, -80, -110, 0, 60, 60})};
  start(ArmConfig{}, path.front());
  const DriveOutcome outcome = follow();
  EXPECT_EQ(outcome.status, DriveStatus::kReached) << outcome.reason;
  EXPECT_LT((arm->state().q - path.back()).cwiseAbs().maxCoeff(), 0.002);
  EXPECT_TRUE(stands());
  EXPECT_LT(off, 0.02);
  EXPECT_LT(toSeconds(outcome.elapsed), 8.0);
}

TEST_F(FollowPath, DoesNotSlowDownAtANearlyStraightCorner) {
  path = {radians({0, -100, -90, 10, 80, 0}), radians({30, -100, -90, 10, 80, 2}),
          radians({60, -100, -90, 10, 80, 0})};
  start(ArmConfig{}, path.front());
  double speed_at_corner = 0.0;
  arm->on_step = [&](const RobotState& state) {
    if (std::abs(state.q[0] - path[1][0]) < 0.03)
      speed_at_corner = std::max(speed_at_corner, state.twist.linear_mps.norm());
  };
  EXPECT_EQ(follow().status, DriveStatus::kReached);
  EXPECT_GT(speed_at_corner, 0.2);
}

// Seven axes: the twist of the flange does not say what the joints do; the path does.
TEST_F(FollowPath, ARedundantArmKeepsItsPostureToo) {
  std::string text = "<robot name='seven'><link name='base'/>";
  for (int i = 1; i <= 7; ++i)
    text += "<link name='l" + std::to_string(i) + "'/><joint name='j" + std::to_string(i) +
            "' type='revolute'><parent link='" + (i == 1 ? "base" : "l" + std::to_string(i - 1)) +
            "'/><child link='l" + std::to_string(i) + "'/><origin xyz='0 0 0.15'/><axis xyz='" +
            (i % 2 ? "0 0 1" : "0 1 0") +
            "'/><limit lower='-2.9' upper='2.9' velocity='2' effort='10'/></joint>";
  const test::TemporaryFolder folder;
  ArmConfig config;
  config.urdf = folder.write("seven.urdf", text + "</robot>").string();
  config.flange_link = "l7";
  path = {radians({0, 40, 0, 60, 0, 40, 0}), radians({50, 40, -50, 60, 30, 40, -20}),
          radians({10, 60, 20, 40, 0, 50, 0})};
  start(config, path.front());
  const DriveOutcome outcome = follow();
  EXPECT_EQ(outcome.status, DriveStatus::kReached) << outcome.reason;
  EXPECT_LT((arm->state().q - path.back()).cwiseAbs().maxCoeff(), 0.002);
  EXPECT_LT(off, 0.02);
}

TEST_F(FollowPath, ASweepIsSlowAndEndsWhenTheWatcherSaysSo) {
  path = {radians({-60, -100, -90, 10, 80, 0}), radians({120, -100, -90, 10, 80, 0})};
  start(ArmConfig{}, path.front());
  int asked = 0;
  FollowOptions options;
  options.max_joint_speed_radps = 0.2;
  options.watch = [&]() -> std::optional<std::string> {
    clock.sleepFor(std::chrono::milliseconds(33));  // A frame.
    ++asked;
    return arm->state().q[0] > 0.0 ? std::optional<std::string>("The camera sees the board.") : std::nullopt;
  };
  const DriveOutcome outcome = follow(options);
  EXPECT_EQ(outcome.status, DriveStatus::kStopped);
  EXPECT_EQ(outcome.reason, "The camera sees the board.");
  EXPECT_TRUE(stands());
  EXPECT_GT(asked, 30);
  EXPECT_LT(fastest_joint, 0.21);
  EXPECT_NEAR(arm->state().q[0], 0.02, 0.06);
}

TEST_F(FollowPath, RefusesBeforeAnyMotionAWayThroughABox) {
  path = {radians({0, -100, -90, 10, 80, 0}), radians({90, -100, -90, 10, 80, 0})};
  const Eigen::Vector3d middle =
      robot::Kinematics(ArmConfig{}).forward(0.5 * (path[0] + path[1])).translation();
  boxes = {{"post", middle - Eigen::Vector3d::Constant(0.04), middle + Eigen::Vector3d::Constant(0.04)}};
  start(ArmConfig{}, path.front());
  const DriveOutcome way = follow();
  EXPECT_EQ(way.status, DriveStatus::kLimit);
  EXPECT_NE(way.reason.find("post"), std::string::npos) << way.reason;
  path.back() = 0.5 * (path[0] + path[1]);
  EXPECT_EQ(follow().status, DriveStatus::kUnreachable);
  path = {radians({10, -100, -90, 10, 80, 0}), radians({20, -100, -90, 10, 80, 0})};
  EXPECT_EQ(follow().status, DriveStatus::kLimit);  // The arm stands elsewhere.
  EXPECT_FALSE(guard->motionSpan().has_value());
}

TEST_F(FollowPath, StopsForTheOperatorAndNamesAnArmThatDoesNotFollow) {
  path = {radians({0, -100, -90, 10, 80, 0}), radians({90, -100, -90, 10, 80, 0})};
  start(ArmConfig{}, path.front(), /*lag_s=*/1e6);
  const DriveOutcome stuck = follow();
  EXPECT_EQ(stuck.status, DriveStatus::kLimit);
  start(ArmConfig{}, path.front());
  FollowOptions options;
  options.watch = [&]() -> std::optional<std::string> {
    guard->operatorStop();
    return std::nullopt;
  };
  EXPECT_EQ(follow(options).status, DriveStatus::kStopped);
  EXPECT_TRUE(stands());
}

TEST_F(FollowPath, RejectsNonsense) {
  start(ArmConfig{}, radians({0, -100, -90, 10, 80, 0}));
  EXPECT_THROW((void)follow(), std::invalid_argument);
  path = {radians({0, 0})};
  EXPECT_THROW((void)follow(), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::servo
