// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/pose.h"

#include <gtest/gtest.h>

#include "poses.h"

namespace servocal {
namespace {

using EndInBase = Pose<Base, EndEffector>;

TEST(Pose, IsNotANumberUntilSet) {
  EXPECT_FALSE(EndInBase().isFinite());
  EXPECT_TRUE(EndInBase::identity().isFinite());
}

TEST(Pose, TakesPointsToItsLeftFrame) {
  const auto bMe = EndInBase::fromRotationVector({0, 0, M_PI / 2}, {1, 2, 3});
  EXPECT_LT((bMe * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(), 1e-15);
}

TEST(Pose, ComposesAndInverts) {
  std::mt19937_64 random(1);
  for (int i = 0; i < 100; ++i) {
    const auto bMe = test::randomPose<Base, EndEffector>(random, 3.0, 1.0);
    const auto eMo = test::randomPose<EndEffector, Board>(random, 3.0, 1.0);
    const Eigen::Vector3d point = test::randomVector(random, 1.0);
    EXPECT_LT(((bMe * eMo) * point - bMe * (eMo * point)).norm(), 1e-14);
    EXPECT_LT(distanceM(bMe * bMe.inverse(), Pose<Base, Base>::identity()), 1e-14);
    EXPECT_LT(angleRad(bMe * bMe.inverse(), Pose<Base, Base>::identity()), 1e-14);
  }
}

// From tiny angles to the neighbourhood of half a turn, where the axis is hard to tell.
TEST(Pose, RotationVectorRoundTrip) {
  std::mt19937_64 random(2);
  for (const double angle : {0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.5, 2.0, 3.0, M_PI - 1e-3, M_PI - 1e-6, M_PI - 1e-9}) {
    for (int i = 0; i < 50; ++i) {
      const Eigen::Vector3d rotation = test::randomVector(random, 1.0).normalized() * angle;
      const auto bMe = EndInBase::fromRotationVector(rotation, {0, 0, 0});
      EXPECT_NEAR((bMe.rotation() * bMe.rotation().transpose() - Eigen::Matrix3d::Identity()).norm(), 0, 1e-14);
      EXPECT_LT((bMe.rotationVector() - rotation).norm(), 1e-12) << angle;
    }
  }
}

TEST(Pose, RotationVectorOfHalfATurnHasEitherSign) {
  for (const Eigen::Vector3d& axis :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0, 0, 1),
        Eigen::Vector3d(1, -1, 0.5).normalized().eval()}) {
    const Eigen::Vector3d rotation =
        EndInBase::fromRotationVector(axis * M_PI, {0, 0, 0}).rotationVector();
    EXPECT_NEAR(rotation.norm(), M_PI, 1e-12);
    EXPECT_NEAR(std::abs(rotation.normalized().dot(axis)), 1.0, 1e-12);
  }
}

// More than half a turn comes back as the shorter way round.
TEST(Pose, RotationVectorIsTheShortWayRound) {
  const Eigen::Vector3d rotation = EndInBase::fromRotationVector({0, 0, 4.0}, {0, 0, 0}).rotationVector();
  EXPECT_LT((rotation - Eigen::Vector3d(0, 0, 4.0 - 2 * M_PI)).norm(), 1e-14);
}

TEST(Pose, AngleIsExactFromNanoradiansToPi) {
  std::mt19937_64 random(3);
  for (const double angle : {0.0, 1e-10, 1e-7, 1e-4, 0.1, 1.0, 3.0, M_PI - 1e-7, M_PI}) {
    for (int i = 0; i < 20; ++i) {
      const auto first = test::randomPose<Base, EndEffector>(random, 3.0, 1.0);
      const Eigen::Vector3d axis = test::randomVector(random, 1.0).normalized();
      const auto second = first * Pose<EndEffector, EndEffector>::fromRotationVector(axis * angle, {0, 0, 0});
      EXPECT_NEAR(angleRad(first, second), angle, 2e-15 + 1e-14 * angle) << angle;
      EXPECT_NEAR(angleRad(second, first), angle, 2e-15 + 1e-14 * angle) << angle;
    }
  }
}

TEST(Pose, QuaternionNeedNotBeNormalized) {
  const auto bMe = EndInBase::fromQuaternion(Eigen::Quaterniond(0, 0, 0, 2), {1, 2, 3});
  EXPECT_LT((bMe.rotation() * Eigen::Vector3d(1, 2, 3) - Eigen::Vector3d(-1, -2, 3)).norm(), 1e-14);
  EXPECT_NEAR(std::abs(bMe.quaternion().z()), 1.0, 1e-15);
}

TEST(Pose, RelabelKeepsTheNumbers) {
  std::mt19937_64 random(4);
  const auto bMe = test::randomPose<Base, EndEffector>(random, 3.0, 1.0);
  const auto eMb = relabel<EndEffector, Base>(bMe);
  EXPECT_EQ(eMb.isometry().matrix(), bMe.isometry().matrix());
}

TEST(Twist, TurnsIntoTheBase) {
  const auto bMe = EndInBase::fromRotationVector({0, 0, M_PI / 2}, {5, 6, 7});
  const Twist<Base> twist = toBase(bMe, Twist<EndEffector>{{1, 0, 0}, {0, 1, 0}});
  EXPECT_LT((twist.linear_mps - Eigen::Vector3d(0, 1, 0)).norm(), 1e-15);
  EXPECT_LT((twist.angular_radps - Eigen::Vector3d(-1, 0, 0)).norm(), 1e-15);
  EXPECT_TRUE(Twist<Base>{}.isZero());
  EXPECT_FALSE(twist.isZero());
}

}  // namespace
}  // namespace servocal
