// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>

#include "cells.h"
#include "errors.h"
#include "fake_arm.h"
#include "servocal/robot/path_planner.h"

namespace servocal::robot {
namespace {

Eigen::VectorXd degrees(std::initializer_list<double> values) {
  Eigen::VectorXd q(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), q.begin());
  return q * M_PI / 180.0;
}

class PlanTo : public ::testing::Test {
 protected:
  PlanTo() {
    cell.limits.workspace = {"workspace", {-1.0, -1.0, -0.1}, {1.0, 1.0, 1.4}};
    cell.limits.keep_out = {{"post", {0.37, -0.13, 0.0}, {0.55, 0.13, 0.7}}};
  }
  void makeGuard() {
    guard = std::make_unique<Guard>(arm, kinematics, clock, cell);
    guard->setBoard(std::nullopt);
  }
  CellConfig cell = test::oneCameraCell();
  Kinematics kinematics{cell.arm};
  SimulatedClock clock;
  Eigen::VectorXd left = degrees({215, -60, 90, -30, 90, 0}), right = degrees({145, -60, 90, -30, 90, 0});
  test::FakeArm arm{kinematics, clock, left};
  std::unique_ptr<Guard> guard;
};

TEST_F(PlanTo, PosturesReachTheGoalAndDiffer) {
  const auto bMe = kinematics.forward(right);
  const auto found = postures(kinematics, bMe, left, 0.05);
  EXPECT_GE(found.size(), 6u);  // Eight, of an arm with a spherical-like wrist.
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_LT(distanceM(kinematics.forward(found[i]), bMe), 2e-4);
    if (i > 0) {
      EXPECT_LE((found[i - 1] - left).cwiseAbs().maxCoeff(), (found[i] - left).cwiseAbs().maxCoeff());
    }
  }
  EXPECT_TRUE(postures(kinematics, {Eigen::Matrix3d::Identity(), Eigen::Vector3d(3, 0, 0)}, left).empty());
}

TEST_F(PlanTo, FindsAWayRoundAndAlwaysTheSame) {
  makeGuard();
  const Plan plan = planTo(*guard, left, kinematics.forward(right));
  ASSERT_FALSE(plan.path.empty()) << plan.reason;
  EXPECT_LT((plan.path.front() - left).norm(), 1e-12);
  EXPECT_LT(distanceM(kinematics.forward(plan.path.back()), kinematics.forward(right)), 2e-4);
  for (std::size_t i = 1; i < plan.path.size(); ++i) {
    const Eigen::VectorXd way = plan.path[i] - plan.path[i - 1];
    const int steps = static_cast<int>(std::ceil(way.cwiseAbs().maxCoeff() / 0.005)) + 1;
    for (int step = 0; step <= steps; ++step)
      EXPECT_TRUE(guard->allows(Eigen::VectorXd(plan.path[i - 1] + way * step / steps)));
  }
  // Whatever was asked in between.
  (void)planTo(*guard, right, kinematics.forward(left));
  const Plan again = planTo(*guard, left, kinematics.forward(right));
  ASSERT_EQ(again.path.size(), plan.path.size());
  for (std::size_t i = 0; i < plan.path.size(); ++i) EXPECT_EQ(again.path[i], plan.path[i]);
}

TEST_F(PlanTo, SaysWhyThereIsNone) {
  makeGuard();
  test::expectPart(planTo(*guard, left, {Eigen::Matrix3d::Identity(), Eigen::Vector3d(3, 0, 0)}).reason,
                   "No joint angles");
  const Plan inside =
      planTo(*guard, left, {kinematics.forward(left).rotation(), Eigen::Vector3d(0.45, 0, 0.4)});
  EXPECT_TRUE(inside.path.empty());
  test::expectPart(inside.reason, "post");
  EXPECT_THROW((void)planTo(*guard, degrees({0, 0}), kinematics.forward(left)), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::robot
