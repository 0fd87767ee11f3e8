// SPDX-License-Identifier: GPL-3.0-or-later
#include "ur5.h"

#include <gtest/gtest.h>

#include "repeatability.h"

namespace servocal::sim {
namespace {

Vector6d joints(double a, double b, double c, double d, double e, double f) {
  return (Vector6d() << a, b, c, d, e, f).finished();
}

std::vector<Vector6d> randomConfigurations(int count) {
  Random random(5, "test");
  std::vector<Vector6d> all(count);
  for (Vector6d& q : all) {
    for (double& angle : q) angle = random.uniform(-M_PI, M_PI);
  }
  return all;
}

// The pose the manufacturer's controller shows with all joints at zero.
TEST(Ur5, StretchedOutMatchesTheController) {
  const Eigen::Isometry3d bMe = Ur5().forward(Vector6d::Zero());
  EXPECT_LT((bMe.translation() - Eigen::Vector3d(-0.81725, -0.19145, -0.005491)).norm(), 1e-9);
  // The flange's z points along -y of the base.
  EXPECT_LT((bMe.linear().col(2) - Eigen::Vector3d(0, -1, 0)).norm(), 1e-12);
}

// Upright, the height is the sum of the link lengths on the drawing.
TEST(Ur5, UprightMatchesTheDrawing) {
  const Eigen::Vector3d flange = Ur5().forward(joints(0, -M_PI / 2, 0, -M_PI / 2, 0, 0)).translation();
  EXPECT_LT((flange - Eigen::Vector3d(0.0, -0.10915 - 0.0823, 0.089159 + 0.425 + 0.39225 + 0.09465)).norm(),
            1e-9);
}

TEST(Ur5, JacobianMatchesDifferences) {
  const Ur5 arm;
  constexpr double kStep = 1e-6;
  for (const Vector6d& q : randomConfigurations(20)) {
    const Matrix6d jacobian = arm.jacobian(q);
    for (int i = 0; i < 6; ++i) {
      Vector6d before = q, after = q;
      before[i] -= kStep;
      after[i] += kStep;
      const Eigen::Isometry3d first = arm.forward(before), second = arm.forward(after);
      const Eigen::AngleAxisd turn(second.linear() * first.linear().transpose());
      Vector6d difference;
      difference << second.translation() - first.translation(), turn.angle() * turn.axis();
      EXPECT_LT((difference / (2 * kStep) - jacobian.col(i)).norm(), 1e-7);
    }
  }
}

TEST(Ur5, PerturbedArmHasTheWantedError) {
  const auto configurations = randomConfigurations(300);
  for (const double wanted_m : {0.0003, 0.002}) {
    Random random(11, "test arm");
    const Ur5 real = Ur5::perturbed(random, wanted_m, configurations);
    double sum = 0.0;
    for (const Vector6d& q : configurations) {
      sum += (real.forward(q).translation() - Ur5().forward(q).translation()).squaredNorm();
    }
    EXPECT_NEAR(std::sqrt(sum / 300) / wanted_m, 1.0, 0.01);
  }
}

TEST(Repeatability, HasTheWantedSizeAndStandsStillWithTheArm) {
  Random random(3, "test");
  const Repeatability error(random, 1e-4, 3.5e-4);
  const auto at = [&](double travelled) { return error.apply(Eigen::Isometry3d::Identity(), travelled); };
  double position = 0.0, rotation = 0.0;
  constexpr int kVisits = 4000;
  for (int visit = 0; visit < kVisits; ++visit) {
    position += at(0.5 * visit).translation().squaredNorm();
    rotation += std::pow(Eigen::AngleAxisd(at(0.5 * visit).linear()).angle(), 2);
  }
  EXPECT_NEAR(std::sqrt(position / kVisits), 1e-4, 5e-6);
  EXPECT_NEAR(std::sqrt(rotation / kVisits), 3.5e-4, 2e-5);
  EXPECT_EQ(at(7.0).matrix(), at(7.0).matrix());
  // Another visit is another error, a hair's breadth of travel is not.
  EXPECT_GT((at(7.0).translation() - at(7.5).translation()).norm(), 1e-5);
  EXPECT_LT((at(7.0).translation() - at(7.0001).translation()).norm(), 1e-6);
}

}  // namespace
}  // namespace servocal::sim
