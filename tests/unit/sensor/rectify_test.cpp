// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor/rectify.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <stdexcept>

#include "depth_scene.h"

namespace servocal::sensor {
namespace {

constexpr double kUnit_m = 0.0001;  // fine, so that rounding is not what is measured

const Pose<Color, Infrared> kBeside =
    Pose<Color, Infrared>::fromRotationVector({0.004, -0.006, 0.003}, {0.052, 0.001, -0.002});

/// Raw depth of a plane normal . X = distance (m) in the infrared camera, as the sensor distorts it.
cv::Mat rawPlane(const DepthModel& sensor, const Eigen::Vector3d& normal, double distance_m) {
  cv::Mat raw(sensor.camera.height_px, sensor.camera.width_px, CV_16UC1);
  for (int row = 0; row < raw.rows; ++row) {
    for (int column = 0; column < raw.cols; ++column) {
      const Eigen::Vector2d pixel(column, row);
      const auto ray = sensor.camera.unproject(pixel);
      const double depth = ray ? distance_m / normal.dot(ray->homogeneous()) : 0.0;
      raw.at<std::uint16_t>(row, column) =
          ray ? cv::saturate_cast<std::uint16_t>(test::distorted(sensor, pixel, depth) / kUnit_m) : 0;
    }
  }
  return raw;
}

class Rectify : public testing::TestWithParam<DepthSensor> {
 protected:
  DepthModel model() const {
    return GetParam() == DepthSensor::kTimeOfFlight ? test::wigglingTimeOfFlight() : test::structuredLight();
  }
};

TEST_P(Rectify, CorrectsAsTheModelDoes) {
  const DepthModel depth = model();
  const DepthRectifier rectifier(depth, test::hdCamera(), kBeside, kUnit_m);
  const cv::Mat raw = rawPlane(depth, Eigen::Vector3d(0.2, -0.1, 1.0).normalized(), 0.8);
  const cv::Mat corrected = rectifier.corrected(raw);
  for (int row = 5; row < raw.rows; row += 40) {
    for (int column = 5; column < raw.cols; column += 40) {
      const auto expected = depth.correct({column, row}, raw.at<std::uint16_t>(row, column) * kUnit_m);
      ASSERT_TRUE(expected);
      EXPECT_NEAR(corrected.at<float>(row, column), *expected, 2e-6);
    }
  }
}

TEST_P(Rectify, PutsAPlaneWhereTheColorCameraSeesIt) {
  const DepthModel depth = model();
  const CameraModel color = test::hdCamera();
  const Eigen::Vector3d normal = Eigen::Vector3d(0.25, -0.15, 1.0).normalized();
  const cv::Mat out = DepthRectifier(depth, color, kBeside, kUnit_m).registered(rawPlane(depth, normal, 0.8));
  // The same plane in the color camera.
  const Eigen::Vector3d normal_c = kBeside.rotation() * normal;
  const double distance_c = 0.8 + normal_c.dot(kBeside.translation());
  int inside = 0, filled = 0;
  double worst = 0.0;
  for (int row = 0; row < out.rows; row += 3) {
    for (int column = 0; column < out.cols; column += 3) {
      const Eigen::Vector3d ray = color.unproject({column, row})->homogeneous();
      const double expected = distance_c / normal_c.dot(ray);
      const auto seen = depth.camera.project(kBeside.inverse() * Eigen::Vector3d(expected * ray));
      if (!seen || !depth.camera.contains(*seen, 3.0)) continue;
      ++inside;
      const float z = out.at<float>(row, column);
      if (z == 0.0F) continue;
      ++filled;
      worst = std::max(worst, std::abs(z - expected));
    }
  }
  EXPECT_GT(inside, 20000);
  EXPECT_GT(filled, 0.995 * inside);
  // A depth pixel stands for itself: two thirds of one on this slope, 1 mm.
  EXPECT_LT(worst, 1.5e-3);
}

TEST_P(Rectify, TheNearerOneIsSeen) {
  const DepthModel depth = model();
  cv::Mat raw = rawPlane(depth, Eigen::Vector3d::UnitZ(), 1.5);
  const cv::Mat near = rawPlane(depth, Eigen::Vector3d::UnitZ(), 0.6);
  const cv::Rect left(0, 0, raw.cols / 2, raw.rows);
  near(left).copyTo(raw(left));
  const CameraModel color = test::hdCamera();
  // The color camera stands 0.2 m to the left: the near half hides a part of the wall.
  const DepthRectifier rectifier(depth, color, Pose<Color, Infrared>::fromRotationVector({0, 0, 0}, {0.2, 0, 0}),
                                 kUnit_m);
  const cv::Mat out = rectifier.registered(raw);
  const auto edge = color.project(Eigen::Vector3d(0.2, 0.0, 0.6));
  const int row = static_cast<int>(edge->y());
  int near_pixels = 0;
  for (int column = static_cast<int>(edge->x()) - 120; column < static_cast<int>(edge->x()) - 8; ++column) {
    EXPECT_NEAR(out.at<float>(row, column), 0.6, 2e-3) << column;
    ++near_pixels;
  }
  EXPECT_EQ(near_pixels, 112);
}

INSTANTIATE_TEST_SUITE_P(Sensors, Rectify,
                         testing::Values(DepthSensor::kTimeOfFlight, DepthSensor::kStructuredLight));

TEST(Rectifier, NoDepthStaysNoDepth) {
  const DepthRectifier rectifier(test::timeOfFlight(), test::hdCamera(), kBeside);
  const cv::Mat none = cv::Mat::zeros(424, 512, CV_16UC1);
  EXPECT_EQ(cv::countNonZero(rectifier.registeredMm(none)), 0);
  EXPECT_EQ(rectifier.registeredMm(none).type(), CV_16UC1);
  EXPECT_THROW((void)rectifier.registered(cv::Mat::zeros(10, 10, CV_16UC1)), std::invalid_argument);
  EXPECT_THROW(DepthRectifier(test::timeOfFlight(), test::hdCamera(), Pose<Color, Infrared>()),
               std::invalid_argument);
}

}  // namespace
}  // namespace servocal::sensor
