// SPDX-License-Identifier: GPL-3.0-or-later
// Other arms and other mounts: a seven-axis arm from a URDF file, a camera on the flange.
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "default_sim.h"
#include "motion_key.h"
#include "servocal/core/error.h"
#include "servocal/robot/kinematics.h"
#include "sim_truth.h"
#include "urdf_arm.h"

namespace servocal::sim {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

const std::filesystem::path kCells = SERVOCAL_TEST_CELLS;

void drive(Cell& cell, const Twist<Base>& twist, Duration duration) {
  for (Duration t{}; t < duration; t += milliseconds(20)) {
    cell.arm().move(test::forgedMotionKey(), twist, milliseconds(100));
    cell.clock().sleepFor(milliseconds(20));
  }
}

class Panda : public ::testing::Test {
 protected:
  CellConfig config = loadCell(kCells / "panda.yaml");
};

// Two walks over the same URDF, ours and KDL's, agree everywhere.
TEST_F(Panda, KinematicsAgreeWithKdl) {
  const UrdfArm own(config.arm);
  const robot::Kinematics kdl(config.arm);
  ASSERT_EQ(own.joints(), 7);
  Random random(1, "configurations");
  for (int i = 0; i < 100; ++i) {
    Joints q(7);
    for (int joint = 0; joint < 7; ++joint) q[joint] = random.uniform(own.lower()[joint], own.upper()[joint]);
    EXPECT_LT((own.forward(q).matrix() - kdl.forward(q).isometry().matrix()).norm(), 1e-9);
    EXPECT_LT((Eigen::MatrixXd(own.jacobian(q)) - kdl.jacobian(q)).norm(), 1e-9);
  }
  EXPECT_EQ(own.lower()[3], -3.0718);
}

// The "ready" pose of the maker's own programs.
TEST_F(Panda, ReadyPoseIsThePublishedOne) {
  Joints q(7);
  q << 0.0, -M_PI / 4, 0.0, -3 * M_PI / 4, 0.0, M_PI / 2, M_PI / 4;
  const Eigen::Isometry3d bMe = UrdfArm(config.arm).forward(q);
  EXPECT_LT((bMe.translation() - Eigen::Vector3d(0.3069, 0.0, 0.5903)).norm(), 2e-4);
  EXPECT_LT((bMe.linear().col(2) + Eigen::Vector3d::UnitZ()).norm(), 1e-9);
}

TEST_F(Panda, MovesByTheTwist) {
  for (const Twist<Base>& twist :
       {Twist<Base>{{0.0, 0.05, -0.03}, {0.0, 0.0, 0.0}}, Twist<Base>{{0.0, 0.0, 0.0}, {0.1, 0.2, 0.0}}}) {
    Cell cell(config, 1);
    const Truth truth(cell);
    EXPECT_EQ(cell.arm().info().joints, 7);
    EXPECT_EQ(cell.arm().info().model, "panda (simulated)");
    const Pose<Base, EndEffector> before = truth.bMe();
    drive(cell, twist, seconds(1));
    const RobotState state = cell.arm().state();
    EXPECT_EQ(state.q.size(), 7);
    EXPECT_LT((state.twist.linear_mps - twist.linear_mps).norm(), 1e-3);
    EXPECT_LT((state.twist.angular_radps - twist.angular_radps).norm(), 1e-3);
    EXPECT_LT((truth.bMe().translation() - before.translation() - twist.linear_mps).norm(), 2e-3);
    const Eigen::AngleAxisd turned(truth.bMe().rotation() * before.rotation().transpose());
    EXPECT_LT((turned.angle() * turned.axis() - twist.angular_radps).norm(), 0.01);
  }
}

TEST_F(Panda, IsAsAccurateAsConfigured) {
  const UrdfArm nominal(config.arm);
  double squares = 0.0;
  constexpr int kSeeds = 40;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    Cell cell(config, seed);
    const Truth truth(cell);
    squares +=
        (truth.bMe().translation() - nominal.forward(Joints(truth.q())).translation()).squaredNorm() / kSeeds;
  }
  // 0.3 mm over the workspace and 0.1 mm of repeatability; at one pose it may be half or twice that.
  EXPECT_GT(std::sqrt(squares), 0.00015);
  EXPECT_LT(std::sqrt(squares), 0.0006);
}

TEST_F(Panda, JointLimitIsAProtectiveStop) {
  Cell cell(config, 1);
  drive(cell, {{0.0, 0.0, 0.0}, {2.0, 0.0, 0.0}}, seconds(3));
  EXPECT_THROW(cell.arm().state(), Error);
  const Eigen::VectorXd q = Truth(cell).q();
  const UrdfArm nominal(config.arm);
  for (int joint = 0; joint < 7; ++joint) {
    EXPECT_GE(q[joint], nominal.lower()[joint]);
    EXPECT_LE(q[joint], nominal.upper()[joint]);
  }
}

TEST_F(Panda, RefusesWhatIsNoChain) {
  CellConfig broken = config;
  broken.arm.flange_link = "gripper";
  EXPECT_THROW(Cell(broken, 1), Error);
  broken = config;
  broken.arm.start_q.conservativeResize(6);
  EXPECT_THROW(Cell(broken, 1), std::invalid_argument);
  broken = config;
  broken.arm.start_q[3] = 0.5;  // Above its upper limit.
  EXPECT_THROW(Cell(broken, 1), std::invalid_argument);
}

class EyeInHand : public ::testing::Test {
 protected:
  CellConfig config = loadCell(kCells / "eye_in_hand.yaml");
};

TEST_F(EyeInHand, CameraFollowsTheFlangeAndTheBoardStays) {
  Cell cell(config, 1);
  const Truth truth(cell);
  const Instant start = cell.clock().now();
  const Pose<EndEffector, Color> eMc = truth.eMc("cam1", start);
  const Pose<Base, Board> bMo = truth.bMo(start);
  EXPECT_LT((bMo.translation() - config.simulation->nominal_bMo->translation()).norm(), 0.05 + 1e-9);
  drive(cell, {{0.0, 0.08, 0.0}, {0.0, 0.0, 0.1}}, seconds(1));
  const Instant now = cell.clock().now();
  EXPECT_EQ(distanceM(truth.bMo(now), bMo), 0.0);
  EXPECT_EQ(distanceM(truth.eMc("cam1", now), eMc), 0.0);
  const Pose<Color, Board> expected = (truth.bMe(now) * eMc).inverse() * bMo;
  EXPECT_LT(distanceM(truth.cMo("cam1", now), expected), 1e-9);
  EXPECT_LT(angleRad(truth.cMo("cam1", now), expected), 1e-7);
}

// The picture moves against the arm: a depth image tells how far the board is, in front and nearer.
TEST_F(EyeInHand, DepthShrinksAsTheCameraApproaches) {
  config.simulation->specular = 0.0;
  Cell cell(config, 1);
  const Truth truth(cell);
  const auto depthAtBoard = [&] {
    const sensor::Frame frame =
        cell.camera("cam1").next(Stream::kDepth, cell.clock().now() + seconds(1)).value();
    const std::vector<Eigen::Vector2d> corners = truth.corners("cam1", frame.stamp, Stream::kDepth);
    const Eigen::Vector2d middle = 0.25 * (corners[7] + corners[8] + corners[13] + corners[14]);
    return 0.001 * cv::mean(frame.image(
                       cv::Rect(static_cast<int>(middle.x()), static_cast<int>(middle.y()), 4, 4)))[0];
  };
  const double before = depthAtBoard();
  EXPECT_NEAR(before, truth.cMo("cam1", cell.clock().now()).translation().z(), 0.05);
  const Eigen::Vector3d forward = truth.bMc("cam1").rotation().col(2);
  drive(cell, {-0.1 * forward, {0.0, 0.0, 0.0}}, seconds(1));  // Back.
  cell.clock().sleepFor(seconds(1));
  EXPECT_NEAR(depthAtBoard() - before, 0.1, 0.012);
}

TEST_F(EyeInHand, RefusesMixedMountsAndABoardThatIsNowhere) {
  CellConfig nowhere = config;
  nowhere.simulation->nominal_bMo.reset();
  EXPECT_THROW(Cell(nowhere, 1), std::invalid_argument);
  CellConfig mixed = config;
  CameraConfig fixed = mixed.cameras[0];
  fixed.name = "other";
  fixed.mount = Mount::kFixed;
  mixed.cameras.push_back(fixed);
  SimulatedCameraConfig simulated = mixed.simulation->cameras[0];
  simulated.name = "other";
  mixed.simulation->cameras.push_back(simulated);
  EXPECT_THROW(Cell(mixed, 1), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::sim
