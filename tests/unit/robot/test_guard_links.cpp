// SPDX-License-Identifier: GPL-3.0-or-later
// What the guard does for the arm's links and for obstacles, by twists and by joint speeds.
#include <gtest/gtest.h>

#include <memory>
#include <random>

#include "cells.h"
#include "errors.h"
#include "fake_arm.h"
#include "shape_gap.h"
#include "servocal/robot/guard.h"

namespace servocal::robot {
namespace {

using test::expectPart;
using test::FakeArm;
using test::FakeArmOptions;

constexpr double kPeriodS = 0.008;
const Pose<EndEffector, Board> kMount = Pose<EndEffector, Board>::fromRotationVector({0, 0, 0}, {0, 0, 0.04});

Eigen::VectorXd degrees(std::initializer_list<double> values) {
  Eigen::VectorXd q(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), q.begin());
  return q * M_PI / 180.0;
}
Eigen::VectorXd jointSpeed(int joint, double radps) {
  Eigen::VectorXd speeds = Eigen::VectorXd::Zero(6);
  speeds[joint] = radps;
  return speeds;
}

class GuardLinks : public ::testing::Test {
 protected:
  GuardLinks() {
    cell.limits.workspace = {"workspace", {-1.2, -1.2, -1.0}, {1.2, 1.2, 1.5}};
    cell.limits.keep_out.clear();
    cell.limits.max_angular_speed_radps = 1.0;
  }
  void stand(const Eigen::VectorXd& q) {
    guard.reset();  // It stops its arm.
    arm = std::make_unique<FakeArm>(kinematics, clock, q);
    guard = std::make_unique<Guard>(*arm, kinematics, clock, cell);
    guard->setBoard(kMount);
    model = std::make_unique<CollisionModel>(cell.arm, cell.limits.keep_out, cell.board);
    model->setBoard(kMount);
    clearance = model->clearance(q);
    arm->on_step = [this](const RobotState& state) {
      clearance = std::min(clearance, model->clearance(state.q));
    };
  }
  template <class Command>
  GuardVerdict hold(const Command& command, double seconds) {
    GuardVerdict verdict;
    for (double t = 0.0; t < seconds; t += kPeriodS) {
      verdict = command();
      if (verdict.rule > strongest.rule) strongest = verdict;
      clock.sleepFor(fromSeconds(kPeriodS));
      arm->state();
    }
    return verdict;
  }
  GuardVerdict turn(int joint, double radps, double seconds) {
    return hold([&] { return guard->commandJoints(jointSpeed(joint, radps)); }, seconds);
  }

  CellConfig cell = test::oneCameraCell();
  Kinematics kinematics{cell.arm};
  SimulatedClock clock;
  std::unique_ptr<FakeArm> arm;
  std::unique_ptr<Guard> guard;
  std::unique_ptr<CollisionModel> model;
  GuardVerdict strongest;
  double clearance = 0.0;  // Least so far.
};

// The flange is far out, only the forearm comes near the post.
TEST_F(GuardLinks, StopsTheForearmBeforeABox) {
  const Eigen::VectorXd stretched = degrees({150, -20, 20, 0, 0, 0});
  const Eigen::Vector3d flange = kinematics.forward(stretched).translation();
  const Eigen::Vector3d beside = kinematics.forward(degrees({175, -20, 20, 0, 0, 0})).translation() * 0.65;
  cell.limits.keep_out = {
      {"post", {beside.x() - 0.03, beside.y() - 0.03, -0.2}, {beside.x() + 0.03, beside.y() + 0.03, 0.8}}};
  stand(stretched);
  const GuardVerdict verdict = turn(0, 0.5, 4.0);
  EXPECT_EQ(strongest.rule, GuardRule::kCollision);
  expectPart(strongest.reason, "keep-out box 'post'");
  expectPart(strongest.reason, "forearm_link");
  EXPECT_TRUE(verdict.refused());
  EXPECT_GT(clearance, 0.004);
  EXPECT_LT(clearance, 0.02);  // It went there, though.
  EXPECT_LT(arm->state().twist.linear_mps.norm(), 1e-3);
  EXPECT_GT((arm->state().bMe.translation() - flange).norm(), 0.05);
  // The way back is free.
  strongest = {};
  (void)turn(0, -0.5, 0.5);
  EXPECT_NE(strongest.rule, GuardRule::kCollision);
}

TEST_F(GuardLinks, StopsTheForearmBeforeTheFootByTwistsToo) {
  for (const bool by_twist : {false, true}) {
    SCOPED_TRACE(by_twist);
    strongest = {};
    stand(degrees({0, -90, 120, 0, 90, 0}));
    ASSERT_GT(clearance, 0.02);
    if (by_twist) {
      // The twist that the elbow would make.
      (void)hold(
          [&] {
            const Eigen::VectorXd twist = kinematics.jacobian(arm->state().q) * jointSpeed(2, 0.5);
            return guard->command({twist.head<3>(), twist.tail<3>()});
          },
          3.0);
    } else {
      (void)turn(2, 0.5, 3.0);
    }
    EXPECT_EQ(strongest.rule, GuardRule::kCollision) << strongest.reason;
    EXPECT_GT(clearance, 0.004);
  }
}

TEST_F(GuardLinks, WithoutAModelNobodyWatchesTheLinks) {
  stand(degrees({0, -90, 120, 0, 90, 0}));
  Guard blind(*arm, kinematics, clock, cell.limits, cell.board);
  blind.setBoard(std::nullopt);
  (void)hold([&] { return blind.commandJoints(jointSpeed(2, 0.5)); }, 3.0);
  EXPECT_EQ(clearance, 0.0);
}

TEST_F(GuardLinks, AnArmThatStandsTooNearMayGoAwayOnly) {
  stand(degrees({0, -90, 165, 0, 90, 0}));
  ASSERT_TRUE(model->contact(arm->state().q).has_value());
  EXPECT_TRUE(guard->objection(arm->state().q).has_value());
  EXPECT_TRUE(turn(2, 0.3, 0.3).refused());
  EXPECT_FALSE(turn(2, -0.3, 3.5).refused());
  EXPECT_FALSE(model->contact(arm->state().q).has_value());
}

TEST_F(GuardLinks, KeepsFlangeBoardAndLinksOutOfTheSpaceAroundACamera) {
  stand(degrees({180, -20, 20, 0, 0, 0}));
  const Eigen::Vector3d flange = kinematics.forward(degrees({200, -20, 20, 0, 0, 0})).translation();
  guard->setObstacles({{"front", flange, 0.15}});
  EXPECT_TRUE(turn(0, 0.5, 4.0).refused());
  expectPart(strongest.reason, "'front'");
  EXPECT_GT((arm->state().bMe.translation() - flange).norm(), 0.15);
  // Half as far out, the forearm is stopped.
  strongest = {};
  stand(degrees({180, -20, 20, 0, 0, 0}));
  guard->setObstacles({{"front", 0.6 * flange, 0.1}});
  EXPECT_TRUE(turn(0, 0.5, 4.0).refused());
  EXPECT_EQ(strongest.rule, GuardRule::kCollision) << strongest.reason;
  expectPart(strongest.reason, "space around 'front'");
  EXPECT_THROW(guard->setObstacles({{"flat", flange, 0.0}}), std::invalid_argument);
}

TEST_F(GuardLinks, JointSpeedsObeyEveryLimit) {
  stand(degrees({0, -60, 60, 0, 90, 0}));
  double flange = 0.0, joint = 0.0;
  arm->on_step = [&](const RobotState& state) { flange = std::max(flange, state.twist.linear_mps.norm()); };
  Eigen::VectorXd last = Eigen::VectorXd::Zero(6);
  for (int i = 0; i < 400; ++i) {
    (void)guard->commandJoints(jointSpeed(i < 200 ? 0 : 5, 30.0));
    const Eigen::VectorXd told = arm->log().back().joints;
    joint = std::max(joint, told.cwiseAbs().maxCoeff());
    EXPECT_LE((told - last).cwiseAbs().maxCoeff(),
              cell.limits.max_angular_acceleration_radps2 * kPeriodS * (1 + 1e-9));
    last = told;
    clock.sleepFor(fromSeconds(kPeriodS));
  }
  EXPECT_LE(flange, cell.limits.max_speed_mps * (1 + 1e-6));
  EXPECT_GT(flange, 0.8 * cell.limits.max_speed_mps);  // The board, farther out, is at its limit.
  EXPECT_LE(joint, cell.limits.max_joint_speed_radps * (1 + 1e-9));
  EXPECT_THROW((void)guard->commandJoints(Eigen::VectorXd::Zero(5)), std::invalid_argument);
  EXPECT_EQ(guard->commandJoints(Eigen::VectorXd::Constant(6, std::nan(""))).rule, GuardRule::kNonFinite);
}

TEST_F(GuardLinks, ChangingTheKindOfCommandBrakesFirst) {
  stand(degrees({0, -60, 60, 0, 90, 0}));
  (void)turn(0, 0.3, 0.5);
  const Twist<Base> twist{{0.0, 0.1, 0.0}, {0.0, 0.0, 0.0}};
  const GuardVerdict verdict = guard->command(twist);
  EXPECT_EQ(verdict.rule, GuardRule::kAcceleration);
  EXPECT_GT(arm->log().back().joints.size(), 0) << "still by joint speeds";
  (void)hold([&] { return guard->command(twist); }, 0.5);
  EXPECT_EQ(arm->log().back().joints.size(), 0);
  EXPECT_NEAR(arm->state().twist.linear_mps.y(), 0.1, 1e-6);
}

// Two ways to the same number: closed forms and FCL.
TEST(CollisionGaps, AgreeWithFcl) {
  CellConfig cell = test::oneCameraCell();
  CollisionModel model(cell.arm, {{"post", {0.3, -0.1, 0.0}, {0.45, 0.1, 0.6}}}, cell.board);
  model.setObstacles({{"ball", {-0.4, 0.2, 0.5}, 0.1}});
  model.setBoard(kMount);
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  int touching = 0;
  for (int sample = 0; sample < 2000; ++sample) {
    Eigen::VectorXd q(6);
    for (double& value : q) value = angle(random);
    double least = 1e9;
    for (const CollisionModel::Gap& gap : model.gaps(q)) least = std::min(least, gap.distance_m);
    const double fcl = model.clearance(q);
    if (least < 1e-4 || fcl < 1e-4) {
      EXPECT_LT(least, 3e-4);
      EXPECT_LT(fcl, 3e-4);
      ++touching;
    } else {
      EXPECT_NEAR(least, fcl, 3e-4) << q.transpose();
    }
  }
  EXPECT_GT(touching, 100);
}

TEST(ShapeGap, GrowsNegativeAsACapsuleEntersABox) {
  const RoundedBox box{{0.1, 0.2, 0.3}, 0.0}, capsule{{0.0, 0.0, 0.15}, 0.05};
  const auto at = [](double x) {
    return Eigen::Isometry3d(Eigen::Translation3d(x, 0.0, 0.0) *
                             Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX()));
  };
  EXPECT_NEAR(gap(box, Eigen::Isometry3d::Identity(), capsule, at(0.2)), 0.05, 1e-6);
  EXPECT_NEAR(gap(capsule, at(0.15), box, Eigen::Isometry3d::Identity()), 0.0, 1e-6);
  EXPECT_NEAR(gap(box, Eigen::Isometry3d::Identity(), capsule, at(0.05)), -0.10, 1e-6);
  // Two capsules that cross.
  EXPECT_NEAR(gap(capsule, at(0.0), capsule, at(0.03)), 0.03 - 0.1, 1e-9);
}

// A joint turns nothing farther than travel() says.
TEST(CollisionGaps, TravelBoundsWhatMoves) {
  CellConfig cell = test::oneCameraCell();
  CollisionModel model(cell.arm, {}, cell.board);
  model.setBoard(kMount);
  const Kinematics kinematics(cell.arm);
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  for (int sample = 0; sample < 200; ++sample) {
    Eigen::VectorXd q(6), dq(6);
    for (double& value : q) value = angle(random);
    for (double& value : dq) value = 0.02 * angle(random);
    for (const Eigen::Vector3d& corner : cell.board.outline())
      EXPECT_LE(
          (kinematics.forward(q + dq) * (kMount * corner) - kinematics.forward(q) * (kMount * corner)).norm(),
          model.travel(dq));
  }
}

}  // namespace
}  // namespace servocal::robot
