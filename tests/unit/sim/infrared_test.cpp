// SPDX-License-Identifier: GPL-3.0-or-later
// Infrared images against OpenCV's projection, and what the print and the light make of them.
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "board_layer.h"
#include "default_sim.h"
#include "sim_truth.h"

namespace servocal::sim {
namespace {

constexpr const char* kCamera = "front";

cv::Mat frameOf(Cell& cell, Stream stream) {
  auto frame = cell.camera(kCamera).next(stream, cell.clock().now() + std::chrono::seconds(1));
  return frame.value().image;
}

/// Corners by OpenCV alone: its projection of the board through the infrared camera's intrinsics.
std::vector<cv::Point2f> projected(const CellConfig& config, const Truth& truth, Instant instant) {
  const Eigen::Isometry3d iMo =
      (truth.cMi(kCamera).inverse() * truth.bMc(kCamera, instant).inverse() * truth.bMo(instant)).isometry();
  const CameraModel model = truth.infrared(kCamera);
  const cv::Matx33d matrix(model.fx(), 0, model.cx(), 0, model.fy(), model.cy(), 0, 0, 1);
  const std::vector<double> distortion(model.parameters.data() + 4, model.parameters.data() + 9);
  const Eigen::AngleAxisd turn(iMo.linear());
  const Eigen::Vector3d r = turn.angle() * turn.axis(), t = iMo.translation();
  std::vector<cv::Point3d> points;
  for (const Eigen::Vector3d& corner : config.board.corners())
    points.emplace_back(corner.x(), corner.y(), 0.0);
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(points, cv::Vec3d(r.x(), r.y(), r.z()), cv::Vec3d(t.x(), t.y(), t.z()), matrix,
                    distortion, pixels);
  return {pixels.begin(), pixels.end()};
}

struct Miss {
  cv::Point2d mean;
  double rms_px = 0.0;  ///< Per axis.
};

/// Corners refined in the image against `expected`.
Miss missOf(const cv::Mat& image, const std::vector<cv::Point2f>& expected) {
  std::vector<cv::Point2f> found = expected;
  cv::cornerSubPix(image, found, cv::Size(4, 4), cv::Size(-1, -1),
                   cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-4));
  Miss miss;
  const auto count = static_cast<double>(found.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    const cv::Point2d error = found[i] - expected[i];
    miss.mean += error / count;
    miss.rms_px += error.dot(error) / (2.0 * count);
  }
  miss.rms_px = std::sqrt(miss.rms_px);
  return miss;
}

class Infrared : public ::testing::TestWithParam<DepthSensor> {
 protected:
  static CellConfig plainBoard() {  // The hollow square's inner edges pull at corner 0.
    CellConfig config = test::kinectSimCell(GetParam());
    std::get<Checkerboard>(config.board.pattern).hollow_corner = false;
    return config;
  }
};

TEST_P(Infrared, CornersAreWhereOpenCvProjectsThem) {
  const CellConfig config = plainBoard();
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Cell cell(config, seed);
    const Truth truth(cell);
    const cv::Mat image = frameOf(cell, Stream::kInfrared);
    ASSERT_EQ(image.type(), CV_8UC1);
    EXPECT_EQ(image.cols, config.cameras[0].infrared->width_px);
    const std::vector<cv::Point2f> expected = projected(config, truth, cell.clock().now());
    const Miss miss = missOf(image, expected);
    EXPECT_LT(miss.rms_px, 0.2) << "seed " << seed;
    EXPECT_LT(cv::norm(miss.mean), 0.06) << "seed " << seed;
    // The truth's own corners agree with OpenCV's, and the measure sees a third of a pixel.
    const std::vector<Eigen::Vector2d> own = truth.corners(kCamera, cell.clock().now(), Stream::kInfrared);
    std::vector<cv::Point2f> shifted;
    for (std::size_t i = 0; i < own.size(); ++i) {
      EXPECT_LT((own[i] - Eigen::Vector2d(expected[i].x, expected[i].y)).norm(), 1e-3);
      shifted.push_back(expected[i] + cv::Point2f(0.33F, 0.0F));
    }
    EXPECT_GT(cv::norm(missOf(image, shifted).mean), 0.2);
  }
}

TEST_P(Infrared, StandsBesideTheColorCamera) {
  const CellConfig config = test::kinectSimCell(GetParam());
  const double nominal_x = GetParam() == DepthSensor::kTimeOfFlight ? -0.052 : 0.025;
  double largest_turn = 0.0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Cell cell(config, seed);
    const Pose<Color, servocal::Infrared> cMi = Truth(cell).cMi(kCamera);
    EXPECT_LE((cMi.translation() - Eigen::Vector3d(nominal_x, 0, 0)).cwiseAbs().maxCoeff(), 0.002 + 1e-9);
    const double turn = cMi.rotationVector().norm();
    EXPECT_LE(turn, 0.010 + 1e-9);
    largest_turn = std::max(largest_turn, turn);
  }
  EXPECT_GT(largest_turn, 0.007);
}

// Black of a laser print stays dark in infrared; of an ink-jet print it vanishes, and in color it does not.
TEST_P(Infrared, InkjetPrintVanishesInInfraredAlone) {
  CellConfig config = plainBoard();
  const auto contrast = [&](Stream stream) {
    Cell cell(config, 2);
    const Truth truth(cell);
    const cv::Mat image = frameOf(cell, stream);
    const std::vector<Eigen::Vector2d> corners = truth.corners(kCamera, cell.clock().now(), stream);
    // The squares about the first corner: means of small patches at their middles.
    const Eigen::Vector2d right = corners[1] - corners[0], down = corners[6] - corners[0];
    const auto gray = [&](double x, double y) {
      const Eigen::Vector2d at = corners[7] + x * right + y * down;
      return cv::mean(image(cv::Rect(static_cast<int>(at.x()) - 1, static_cast<int>(at.y()) - 1, 3, 3)))[0];
    };
    const double even = gray(0.5, 0.5) + gray(-0.5, -0.5), odd = gray(0.5, -0.5) + gray(-0.5, 0.5);
    return std::abs(even - odd) / (even + odd);
  };
  EXPECT_GT(contrast(Stream::kInfrared), 0.35);
  EXPECT_LT(contrast(Stream::kInfrared), contrast(Stream::kColor));  // Toner is grayer there.
  SimulationFault fault;
  fault.kind = FaultKind::kInkjetPrint;
  config.simulation->faults = {fault};
  EXPECT_LT(contrast(Stream::kInfrared), 0.08);
  EXPECT_GT(contrast(Stream::kColor), 0.5);
}

INSTANTIATE_TEST_SUITE_P(Kinects, Infrared,
                         ::testing::Values(DepthSensor::kTimeOfFlight, DepthSensor::kStructuredLight),
                         [](const auto& kinect) { return toString(kinect.param); });

// A projector that is not blocked breaks the white of the board into dots.
TEST(StructuredLightInfrared, ProjectorDots) {
  CellConfig config = test::kinectSimCell(DepthSensor::kStructuredLight);
  const auto roughness = [&](bool dots) {
    auto infrared = SimulatedInfraredConfig::like(*config.cameras[0].infrared);
    infrared.projector_dots = dots;
    config.simulation->cameras[0].infrared = infrared;
    Cell cell(config, 2);
    const Truth truth(cell);
    const cv::Mat image = frameOf(cell, Stream::kInfrared);
    // A white square: the second of the second row of inner squares.
    const std::vector<Eigen::Vector2d> corners =
        truth.corners(kCamera, cell.clock().now(), Stream::kInfrared);
    const Eigen::Vector2d middle = 0.25 * (corners[0] + corners[1] + corners[6] + corners[7]);
    const Eigen::Vector2d white = middle + (corners[1] - corners[0]);
    cv::Scalar mean, deviation;
    cv::meanStdDev(image(cv::Rect(static_cast<int>(white.x()) - 5, static_cast<int>(white.y()) - 5, 10, 10)),
                   mean, deviation);
    return deviation[0];
  };
  EXPECT_LT(roughness(false), 12.0);
  EXPECT_GT(roughness(true), 35.0);
}

// The camera's own light: a board twice as far off is darker, though the gain makes up for a part.
TEST(ActiveLight, FallsWithDistanceAndTowardsTheCorners) {
  ActiveLight light;
  light.range_m = 0.7;
  light.centre_px = {256, 212};
  light.fall_per_px2 = 0.45 / light.centre_px.squaredNorm();
  const double near = light.at(256, 212, 0.7, 0.7), far = light.at(256, 212, 1.4, 1.4);
  EXPECT_NEAR(near, 1.0, 1e-12);
  EXPECT_NEAR(far, 0.5, 1e-12);  // 1/4 by distance, gain 2.
  EXPECT_NEAR(light.at(0, 0, 0.7, 0.7), 0.55, 1e-12);
  // Within one image there is one gain.
  EXPECT_NEAR(light.at(256, 212, 0.8, 0.7), 49.0 / 64.0, 1e-12);
}

}  // namespace
}  // namespace servocal::sim
