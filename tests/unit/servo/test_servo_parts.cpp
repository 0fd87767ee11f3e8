// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "approach.h"
#include "point_servo.h"
#include "servo_bench.h"
#include "view_tracker.h"
#include "visibility.h"

namespace servocal::servo {
namespace {

using test::kDegree;

const std::vector<Eigen::Vector3d> kPoints = BoardSpec().corners();
const Pose<EndEffector, Board> kMount =
    Pose<EndEffector, Board>::fromRotationVector({3.0, 0.1, -0.15}, {0.02, -0.03, 0.04});

Pose<Color, Board> view(const Eigen::Vector3d& rotation, const Eigen::Vector3d& position) {
  return Pose<Color, Board>::fromRotationVector(rotation, position);
}

// The law's motion is, to first order, the very motion that separates the two poses. Fixes sign, frames
// and units at once.
TEST(PointServo, FindsTheSmallMotionBetweenTwoViews) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 20; ++i) {
    const auto cMo = view(test::randomVector(random, 0.3), {0.05, -0.03, 0.6});
    const Twist<EndEffector> motion{test::randomVector(random, 1e-4), test::randomVector(random, 2e-4)};
    const auto step = Pose<EndEffector, EndEffector>::fromRotationVector(motion.angular_radps, motion.linear_mps);
    const Pose<Color, EndEffector> cMe = cMo * kMount.inverse();
    const auto cdMo = cMe * step * kMount;
    const Twist<EndEffector> found = pointServo(imagePoints(cMo, kPoints), imagePoints(cdMo, kPoints), cMe, Mount::kFixed);
    EXPECT_LT((found.linear_mps - motion.linear_mps).norm(), 3e-6);
    EXPECT_LT((found.angular_radps - motion.angular_radps).norm(), 1e-5);

    // Negative control: with another instant's matrix the same law goes elsewhere.
    const Pose<Color, EndEffector> stale = view({0, 0, 1.5}, {0, 0, 0.6}) * kMount.inverse();
    const Twist<EndEffector> astray = pointServo(imagePoints(cMo, kPoints), imagePoints(cdMo, kPoints), stale,
                                               Mount::kFixed);
    EXPECT_GT((astray.linear_mps - motion.linear_mps).norm(), 1e-5);
  }
}

// The same for a camera that rides on the flange while the target stands.
TEST(PointServo, FindsTheSmallMotionOfACameraOnTheFlange) {
  std::mt19937_64 random(4);
  const Pose<EndEffector, Color> eMc = test::randomPose<EndEffector, Color>(random, 2.0, 0.08);
  for (int i = 0; i < 20; ++i) {
    const auto cMo = view(test::randomVector(random, 0.3), {0.05, -0.03, 0.6});
    const Twist<EndEffector> motion{test::randomVector(random, 1e-4), test::randomVector(random, 2e-4)};
    const auto step = Pose<EndEffector, EndEffector>::fromRotationVector(motion.angular_radps, motion.linear_mps);
    const Pose<Color, Board> cdMo = eMc.inverse() * step.inverse() * eMc * cMo;
    const Twist<EndEffector> found = pointServo(imagePoints(cMo, kPoints), imagePoints(cdMo, kPoints), eMc.inverse(),
                                                Mount::kFlange);
    EXPECT_LT((found.linear_mps - motion.linear_mps).norm(), 3e-6);
    EXPECT_LT((found.angular_radps - motion.angular_radps).norm(), 1e-5);
  }
}

// Two calls in a row: the second does not remember the first.
TEST(PointServo, HasNoMemory) {
  const auto cMo = view({0.1, 0, 0}, {0, 0, 0.6}), other = view({0, 0.3, 0.2}, {0.1, 0.05, 0.5}), goal = view({0, 0, 0}, {0, 0, 0.55});
  const auto ask = [&](const Pose<Color, Board>& from) {
    return pointServo(imagePoints(from, kPoints), imagePoints(goal, kPoints), from * kMount.inverse(), Mount::kFixed);
  };
  const Twist<EndEffector> first = ask(cMo);
  (void)ask(other);
  const Twist<EndEffector> again = ask(cMo);
  EXPECT_EQ(first.linear_mps, again.linear_mps);
  EXPECT_EQ(first.angular_radps, again.angular_radps);
  EXPECT_THROW(pointServo({}, {}, cMo * kMount.inverse(), Mount::kFixed), std::invalid_argument);
}

TEST(ViewTracker, CarriesTheViewByTheArmsMotion) {
  const CameraModel camera = test::Bench::trueCamera();
  std::mt19937_64 random(5);
  const auto bMc = test::randomPose<Base, Color>(random, 3.0, 1.0);
  const auto cMo = view({0.1, -0.2, 0.05}, {0.03, 0.02, 0.6});
  const Pose<Base, EndEffector> before = bMc * cMo * kMount.inverse();
  const Pose<Base, EndEffector> after = before * Pose<EndEffector, EndEffector>::fromRotationVector({0.02, 0.01, -0.03}, {0.01, 0.005, -0.004});
  Sight sight;
  sight.cMo = cMo;
  for (const Eigen::Vector3d& point : kPoints) sight.pixels.push_back(*camera.project(cMo * point));
  CellEstimate cell;
  cell.camera = camera;
  cell.eMo = kMount;
  ViewTracker tracker(kPoints, cell);
  ASSERT_TRUE(tracker.update(sight, before));
  const Pose<Color, Board> truth = bMc.inverse() * after * kMount;
  EXPECT_LT(distanceM(tracker.at(after).cMo, truth), 1e-12);
  for (std::size_t i = 0; i < kPoints.size(); ++i)
    EXPECT_LT((tracker.at(after).points[i].s - imagePoints(truth, kPoints)[i].s).norm(), 1e-8);

  sight.pixels[3].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(tracker.update(sight, before));
  sight.pixels.pop_back();
  EXPECT_FALSE(tracker.update(sight, before));
}

TEST(Visibility, PixelRatesAreTheDerivative) {
  const CameraModel camera = test::Bench::trueCamera();
  const auto cMo = view({0.2, -0.3, 0.1}, {0.05, 0.03, 0.6});
  View now;
  now.cMo = cMo;
  now.cMe = cMo * kMount.inverse();
  now.points = imagePoints(cMo, kPoints);
  const auto motion = pixelMotion(camera, now, kPoints);
  ASSERT_TRUE(motion);
  std::mt19937_64 random(9);
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector3d v = test::randomVector(random, 1.0), w = test::randomVector(random, 1.0);
    const double h = 1e-6;
    const auto step = Pose<EndEffector, EndEffector>::fromRotationVector(h * w, h * v);
    const Eigen::VectorXd rates = motion->rates * (Eigen::Matrix<double, 6, 1>() << v, w).finished();
    for (std::size_t k = 0; k < kPoints.size(); ++k) {
      const Eigen::Vector2d moved = *camera.project(now.cMe * step * kMount * kPoints[k]);
      const Eigen::Vector2d rate = (moved - motion->pixels[k]) / h;
      EXPECT_LT((rate - rates.segment<2>(2 * static_cast<Eigen::Index>(k))).norm(), 1e-2 * (1 + rate.norm()));
    }
  }
}

// A camera on the flange: the view as the tracker carries it, and the pixels' rates, against the true chain.
TEST(ViewTracker, CarriesTheViewOfACameraOnTheFlange) {
  std::mt19937_64 random(6);
  CellEstimate cell;
  cell.camera = test::Bench::trueCamera();
  cell.mount = Mount::kFlange;
  cell.eMc = test::randomPose<EndEffector, Color>(random, 2.0, 0.08);
  const auto before = test::randomPose<Base, EndEffector>(random, 3.0, 1.0);
  const auto cMo = view({0.1, -0.2, 0.05}, {0.03, 0.02, 0.6});
  const Pose<Base, Board> bMo = before * cell.eMc * cMo;
  Sight sight;
  sight.cMo = cMo;
  for (const Eigen::Vector3d& point : kPoints) sight.pixels.push_back(*cell.camera.project(cMo * point));
  ViewTracker tracker(kPoints, cell);
  ASSERT_TRUE(tracker.update(sight, before));
  const Pose<Base, EndEffector> after =
      before * Pose<EndEffector, EndEffector>::fromRotationVector({0.02, 0.01, -0.03}, {0.01, 0.005, -0.004});
  const View now = tracker.at(after);
  EXPECT_LT(distanceM(now.cMo, cell.eMc.inverse() * after.inverse() * bMo), 1e-12);

  const auto motion = pixelMotion(cell.camera, now, kPoints);
  ASSERT_TRUE(motion);
  const Eigen::Vector3d v(0.3, -0.5, 0.2), w(-0.4, 0.6, 0.5);
  const double h = 1e-6;
  const auto step = Pose<EndEffector, EndEffector>::fromRotationVector(h * w, h * v);
  const Eigen::VectorXd rates = motion->rates * (Eigen::Matrix<double, 6, 1>() << v, w).finished();
  for (std::size_t k = 0; k < kPoints.size(); ++k) {
    const Eigen::Vector2d moved =
        *cell.camera.project(cell.eMc.inverse() * (after * step).inverse() * bMo * kPoints[k]);
    const Eigen::Vector2d rate = (moved - motion->pixels[k]) / h;
    EXPECT_LT((rate - rates.segment<2>(2 * static_cast<Eigen::Index>(k))).norm(), 1e-2 * (1 + rate.norm()));
  }
}

// Near the border: what would cross the margin slides along it, all else is left alone.
TEST(Visibility, PointsSlideAlongTheMargin) {
  const CameraModel camera = test::Bench::trueCamera();
  const auto cMo = view({0, 0, 0}, {0.42, 0.0, 0.6});
  View now;
  now.cMo = cMo;
  now.cMe = cMo * kMount.inverse();
  now.points = imagePoints(cMo, kPoints);
  const auto motion = pixelMotion(camera, now, kPoints);
  ASSERT_TRUE(motion);
  const double margin = 25.0, rate = 5.0;
  std::mt19937_64 random(11);
  int changed = 0;
  for (int i = 0; i < 500; ++i) {
    const Twist<EndEffector> wanted{test::randomVector(random, 0.3), test::randomVector(random, 0.5)};
    const auto breaks = [&](const Twist<EndEffector>& twist) {
      const Eigen::VectorXd rates = motion->rates * (Eigen::Matrix<double, 6, 1>() << twist.linear_mps, twist.angular_radps).finished();
      for (std::size_t k = 0; k < kPoints.size(); ++k) {
        const Eigen::Vector2d p = motion->pixels[k], d = rates.segment<2>(2 * static_cast<Eigen::Index>(k));
        if (-d.x() > rate * std::max(0.0, p.x() - margin) + 0.1 || d.x() > rate * std::max(0.0, camera.width_px - 1 - margin - p.x()) + 0.1 ||
            -d.y() > rate * std::max(0.0, p.y() - margin) + 0.1 || d.y() > rate * std::max(0.0, camera.height_px - 1 - margin - p.y()) + 0.1)
          return true;
      }
      return false;
    };
    const Twist<EndEffector> inside = keepInView(wanted, *motion, camera, margin, rate);
    EXPECT_FALSE(breaks(inside)) << i;
    if (breaks(wanted)) {
      ++changed;
      EXPECT_GT(inside.linear_mps.norm() + inside.angular_radps.norm(), 1e-3);
    } else {
      EXPECT_EQ(inside.linear_mps, wanted.linear_mps);
    }
  }
  EXPECT_GT(changed, 50);  // Negative control: unfiltered, many would have crossed.
}

TEST(Approach, EndsInAnExponentialAndStartsAtTheLimits) {
  MotionLimits limits;
  EXPECT_NEAR(approachGain(1.0, 0.0, limits, 12.0, 1.0), 0.25, 1e-12);
  EXPECT_NEAR(approachGain(1.0, 0.0, limits, 12.0, 0.5), 0.125, 1e-12);
  EXPECT_NEAR(approachGain(0.001, 0.001, limits, 12.0, 1.0), 12.0, 1e-12);
  EXPECT_NEAR(approachGain(0.0, 2.0, limits, 12.0, 1.0), 0.25, 1e-12);
  // Along the curve the deceleration never exceeds the limit.
  double distance = 0.3, last = 0.25;
  while (distance > 1e-4) {
    const double speed = distance * approachGain(distance, 0.0, limits, 12.0, 1.0);
    EXPECT_GT(speed - last, -1.2 * 0.001);
    last = speed;
    distance -= 0.001 * speed;
  }
}

}  // namespace
}  // namespace servocal::servo
