// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/visp.h"

#include <gtest/gtest.h>
#include <visp3/core/vpVelocityTwistMatrix.h>

#include "poses.h"

namespace servocal {
namespace {

// There and back, and the product of converted poses is the converted product.
TEST(Visp, PosesSurviveTheConversion) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 100; ++i) {
    const auto bMe = test::randomPose<Base, EndEffector>(random, 3.0, 2.0);
    const auto eMo = test::randomPose<EndEffector, Board>(random, 3.0, 2.0);
    const auto back = fromVisp<Base, EndEffector>(toVisp(bMe));
    EXPECT_EQ((back.isometry().matrix() - bMe.isometry().matrix()).cwiseAbs().maxCoeff(), 0.0);
    const auto product = fromVisp<Base, Board>(toVisp(bMe) * toVisp(eMo));
    EXPECT_LT((product.isometry().matrix() - (bMe * eMo).isometry().matrix()).cwiseAbs().maxCoeff(), 1e-15 * 4);
    const auto inverse = fromVisp<EndEffector, Base>(toVisp(bMe).inverse());
    EXPECT_LT((inverse.isometry().matrix() - bMe.inverse().isometry().matrix()).cwiseAbs().maxCoeff(), 1e-15 * 4);
  }
}

// Linear part first on both sides: a twist moved to another frame by ViSP's twist matrix and by hand.
TEST(Visp, TwistsHaveTheirPartsInTheSameOrder) {
  std::mt19937_64 random(5);
  const auto cMe = test::randomPose<Color, EndEffector>(random, 3.0, 1.0);
  const Twist<EndEffector> twist{test::randomVector(random, 1.0), test::randomVector(random, 1.0)};
  const auto back = twistFromVisp<EndEffector>(toVisp(twist));
  EXPECT_EQ(back.linear_mps, twist.linear_mps);
  EXPECT_EQ(back.angular_radps, twist.angular_radps);

  const auto moved = twistFromVisp<Color>(vpVelocityTwistMatrix(toVisp(cMe)) * toVisp(twist));
  const Eigen::Vector3d angular = cMe.rotation() * twist.angular_radps;
  const Eigen::Vector3d linear =
      cMe.rotation() * twist.linear_mps + cMe.translation().cross(angular);
  EXPECT_LT((moved.linear_mps - linear).norm(), 1e-14);
  EXPECT_LT((moved.angular_radps - angular).norm(), 1e-14);
  EXPECT_THROW(twistFromVisp<Color>(vpColVector(5)), std::invalid_argument);
}

// Negative control: the comparison above sees an inverse that was forgotten.
TEST(Visp, MeasureSeesAForgottenInverse) {
  std::mt19937_64 random(7);
  const auto bMe = test::randomPose<Base, EndEffector>(random, 3.0, 2.0);
  const auto wrong = fromVisp<Base, EndEffector>(toVisp(bMe.inverse()));
  EXPECT_GT((wrong.isometry().matrix() - bMe.isometry().matrix()).cwiseAbs().maxCoeff(), 1e-3);
}

}  // namespace
}  // namespace servocal
