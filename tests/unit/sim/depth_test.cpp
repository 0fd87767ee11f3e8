// SPDX-License-Identifier: GPL-3.0-or-later
// Depth images against planes by OpenCV's undistortion, and the size and shape of their errors.
#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <set>

#include "default_sim.h"
#include "sim_truth.h"

namespace servocal::sim {
namespace {

constexpr const char* kCamera = "front";
constexpr double kFocalBaseline = 580.0 * 0.075;  ///< Nominal, of a Kinect v1; px m.

SimulatedDepthConfig& depthOf(CellConfig& config) {
  auto& infrared = config.simulation->cameras[0].infrared;
  if (!infrared) infrared = SimulatedInfraredConfig::like(*config.cameras[0].infrared);
  return infrared->depth;
}

void removeErrors(CellConfig& config) {
  SimulatedDepthConfig& depth = depthOf(config);
  depth.offset_m = depth.offset_spread_m = depth.slope_spread = depth.wiggle_m = depth.lateral_m = 0.0;
  depth.black_m = 0.0;
}

void removeNoise(CellConfig& config) { depthOf(config).noise_m = depthOf(config).noise_per_m2 = 0.0; }

/// The board square in front of the camera whatever the seed.
void fixGeometry(CellConfig& config) {
  config.simulation->mount_rotation_spread_rad = 0.0;
  config.simulation->mount_translation_spread_m = 0.0;
  config.simulation->cameras[0].position_spread_m = 0.0;
  config.simulation->cameras[0].rotation_spread_rad = 0.0;
}

struct Seen {
  cv::Mat image;
  Eigen::Isometry3d iMo;
  cv::Matx33d matrix;
  std::vector<double> distortion;
  Eigen::Vector2d half_m;  ///< Of the plate.

  /// Depth of the board's plane at a pixel and where on the board that is, through OpenCV's undistortion.
  std::pair<double, Eigen::Vector2d> plane(int u, int v) const {
    const std::vector<cv::Point2d> pixel = {cv::Point2d(u, v)};
    std::vector<cv::Point2d> ray;
    cv::undistortPoints(pixel, ray, matrix, distortion, cv::noArray(), cv::noArray(),
                        cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-12));
    const Eigen::Vector3d direction(ray[0].x, ray[0].y, 1.0);
    const Eigen::Vector3d normal = iMo.linear().col(2);
    const double z = normal.dot(iMo.translation()) / normal.dot(direction);
    const Eigen::Vector3d on_board = iMo.inverse() * (z * direction);
    return {z, on_board.head<2>()};
  }
  /// True if the pixel looks at the plate, at least this far from its rim.
  bool inside(const Eigen::Vector2d& on_board, double from_rim_m) const {
    return std::abs(on_board.x()) < half_m.x() - from_rim_m &&
           std::abs(on_board.y()) < half_m.y() - from_rim_m;
  }
};

Seen look(Cell& cell, const CellConfig& config) {
  const Truth truth(cell);
  const auto frame = cell.camera(kCamera).next(Stream::kDepth, cell.clock().now() + std::chrono::seconds(1));
  Seen seen;
  seen.image = frame.value().image;
  seen.iMo = (truth.cMi(kCamera).inverse() * truth.cMo(kCamera, frame->stamp)).isometry();
  const CameraModel model = truth.infrared(kCamera);
  seen.matrix = cv::Matx33d(model.fx(), 0, model.cx(), 0, model.fy(), model.cy(), 0, 0, 1);
  seen.distortion.assign(model.parameters.data() + 4, model.parameters.data() + 9);
  seen.half_m = config.board.outline()[2].head<2>().cwiseAbs();
  return seen;
}

class Depth : public ::testing::TestWithParam<DepthSensor> {
 protected:
  bool timeOfFlight() const { return GetParam() == DepthSensor::kTimeOfFlight; }
  double roundingM(double z) const {
    return timeOfFlight() ? 0.00055 : 0.0005 + 0.56 * 0.125 * z * z / kFocalBaseline;
  }
};

TEST_P(Depth, WithoutErrorsIsThatOfTheBoardsPlane) {
  CellConfig config = test::kinectSimCell(GetParam());
  config.simulation->specular = 0.0;
  removeErrors(config);
  removeNoise(config);
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    Cell cell(config, seed);
    const Seen seen = look(cell, config);
    ASSERT_EQ(seen.image.type(), CV_16UC1);
    int pixels = 0, wrong = 0, missing = 0, floating = 0;
    for (int v = 0; v < seen.image.rows; v += 3) {
      for (int u = 0; u < seen.image.cols; u += 3) {
        const auto [z, on_board] = seen.plane(u, v);
        const double measured_m = 0.001 * seen.image.at<std::uint16_t>(v, u);
        if (seen.inside(on_board, 0.006)) {
          ++pixels;
          missing += measured_m == 0.0;
          wrong += measured_m > 0.0 && std::abs(measured_m - z) > roundingM(z);
        } else if (!seen.inside(on_board, -0.006)) {  // The wall behind, or the projector's shadow.
          floating += measured_m > 0.0 && measured_m < 2.0;
        }
      }
    }
    EXPECT_GT(pixels, 500) << "seed " << seed;
    EXPECT_EQ(wrong, 0) << "seed " << seed;
    EXPECT_EQ(missing, 0) << "seed " << seed;
    EXPECT_EQ(floating, 0) << "seed " << seed;
  }
}

// Bias before noise: what a pixel reads on average is what the truth says, and that can be undone.
TEST_P(Depth, ReadsWhatTheTruthSays) {
  CellConfig config = test::kinectSimCell(GetParam());
  config.simulation->specular = 0.0;
  depthOf(config).black_m = 0.0;
  removeNoise(config);
  Cell cell(config, 3);
  const Truth truth(cell);
  const Seen seen = look(cell, config);
  double largest_error_m = 0.0;
  for (int v = 0; v < seen.image.rows; v += 5) {
    for (int u = 0; u < seen.image.cols; u += 5) {
      const auto [z, on_board] = seen.plane(u, v);
      if (!seen.inside(on_board, 0.006)) continue;
      const double expected_m = truth.measuredDepth(kCamera, Eigen::Vector2d(u, v), z);
      EXPECT_NEAR(0.001 * seen.image.at<std::uint16_t>(v, u), expected_m, roundingM(expected_m));
      EXPECT_NEAR(truth.trueDepth(kCamera, Eigen::Vector2d(u, v), expected_m), z, 1e-9);
      largest_error_m = std::max(largest_error_m, std::abs(expected_m - z));
    }
  }
  EXPECT_GT(largest_error_m, 0.003);  // There is something to be calibrated.
}

// Sizes of the systematic errors over seeds, image and range.
TEST_P(Depth, ErrorsAreAsLargeAsConfigured) {
  const CellConfig config = test::kinectSimCell(GetParam());
  double offset = 0.0, lateral = 0.0, slope = 0.0;
  constexpr int kSeeds = 30;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    Cell cell(config, seed);
    const Truth truth(cell);
    const CameraModel model = truth.infrared(kCamera);
    double sum = 0.0, squares = 0.0;
    int count = 0;
    for (int v = 8; v < model.height_px; v += 16) {
      for (int u = 8; u < model.width_px; u += 16, ++count) {
        const double error = truth.measuredDepth(kCamera, Eigen::Vector2d(u, v), 1.0) - 1.0;
        sum += error;
        squares += error * error;
      }
    }
    offset += sum / count / kSeeds;
    lateral += (squares / count - sum / count * sum / count) / kSeeds;
    const Eigen::Vector2d middle(model.cx(), model.cy());
    slope += std::abs(truth.measuredDepth(kCamera, middle, 1.2) - truth.measuredDepth(kCamera, middle, 0.7) -
                      0.5) /
             0.5 / kSeeds;
  }
  if (timeOfFlight()) {
    EXPECT_NEAR(offset, 0.024 * 0.88, 0.003);  // Along the ray: less along the axis beside it.
    EXPECT_NEAR(std::sqrt(lateral), 0.0030, 0.0012);
  } else {
    EXPECT_NEAR(offset, 0.0, 0.003);
    EXPECT_NEAR(std::sqrt(lateral), 0.0030, 0.0008);
  }
  EXPECT_GT(slope, 0.002);
  EXPECT_LT(slope, 0.02);
}

struct Scatter {
  double temporal_m = 0.0;  ///< Of one pixel over frames, RMS over pixels.
  double lasting_m = 0.0;   ///< Of the pixels' means about the plane they should read.
  double mean_m = 0.0;
};

/// Board facing the camera at about 0.6 m.
Scatter measureScatter(CellConfig config, double nearer_m) {
  fixGeometry(config);
  config.simulation->cameras[0].position_m.x() += nearer_m;
  config.simulation->specular = 0.0;
  removeErrors(config);
  Cell cell(config, 5);
  constexpr int kFrames = 40;
  std::vector<cv::Mat> frames;
  Seen seen;
  for (int k = 0; k < kFrames; ++k) {
    seen = look(cell, config);
    frames.push_back(seen.image);
  }
  Scatter scatter;
  double temporal = 0.0, lasting = 0.0;
  int pixels = 0;
  for (int v = 0; v < seen.image.rows; v += 2) {
    for (int u = 0; u < seen.image.cols; u += 2) {
      const auto [z, on_board] = seen.plane(u, v);
      if (!seen.inside(on_board, 0.01)) continue;
      double sum = 0.0, squares = 0.0;
      for (const cv::Mat& frame : frames) {
        const double error = 0.001 * frame.at<std::uint16_t>(v, u) - z;
        sum += error;
        squares += error * error;
      }
      const double mean = sum / kFrames;
      temporal += (squares - kFrames * mean * mean) / (kFrames - 1);
      lasting += mean * mean;
      scatter.mean_m += z;
      ++pixels;
    }
  }
  scatter.temporal_m = std::sqrt(temporal / pixels);
  scatter.lasting_m = std::sqrt(lasting / pixels);
  scatter.mean_m /= pixels;
  return scatter;
}

TEST_P(Depth, NoiseHasItsSizeAndAPartOfItStays) {
  for (const double nearer_m : {0.0, 0.5}) {
    const Scatter scatter = measureScatter(test::kinectSimCell(GetParam()), nearer_m);
    const double off = scatter.mean_m - 0.4;
    const double sigma = timeOfFlight() ? 0.0015 : 0.0012 + 0.0019 * off * off;
    const double step = timeOfFlight() ? 0.001 : 0.125 * scatter.mean_m * scatter.mean_m / kFocalBaseline;
    const double rounding = step * step / 12.0;
    // At 0.6 m steps of disparity are about a millimetre and rounding to that shrinks them.
    EXPECT_NEAR(scatter.temporal_m / std::sqrt(0.7 * sigma * sigma + rounding), 1.0, 0.06) << scatter.mean_m;
    EXPECT_NEAR(scatter.lasting_m / std::sqrt(0.3 * sigma * sigma), 1.06, 0.15) << scatter.mean_m;
  }
}

TEST(StructuredLightDepth, IsQuantisedInDisparity) {
  CellConfig config = test::kinectSimCell(DepthSensor::kStructuredLight);
  Cell cell(config, 1);
  std::set<int> values;
  for (int k = 0; k < 5; ++k) {
    const cv::Mat image = look(cell, config).image;
    for (auto it = image.begin<std::uint16_t>(); it != image.end<std::uint16_t>(); ++it) {
      if (*it > 2000 && *it < 3000) values.insert(*it);
    }
  }
  // 8 f b (1/2.0 - 1/3.0) steps at most, about 14 to 26 mm apart; without quantisation there were hundreds.
  EXPECT_GT(values.size(), 15u);
  EXPECT_LT(values.size(), 62u);
  int last = 0;
  for (const int value : values) {
    EXPECT_TRUE(last == 0 || value - last >= 10) << value;
    last = value;
  }
}

TEST_P(Depth, NothingIsMeasuredAtEdgesInHighlightsAndOutOfRange) {
  CellConfig config = test::kinectSimCell(GetParam());
  fixGeometry(config);
  const auto invalid = [&](double from_rim_m, double to_rim_m) {
    Cell cell(config, 1);
    const Seen seen = look(cell, config);
    int zeros = 0, pixels = 0;
    for (int v = 0; v < seen.image.rows; v += 2) {
      for (int u = 0; u < seen.image.cols; u += 2) {
        const auto [z, on_board] = seen.plane(u, v);
        if (seen.inside(on_board, to_rim_m) || !seen.inside(on_board, from_rim_m)) continue;
        ++pixels;
        zeros += seen.image.at<std::uint16_t>(v, u) == 0;
      }
    }
    return static_cast<double>(zeros) / pixels;
  };
  EXPECT_GT(invalid(-0.0005, 0.0005), 0.95);  // The rim itself.
  const double shiny = invalid(0.01, 1.0);
  EXPECT_GT(shiny, 0.01);  // The highlight of a board that faces the camera.
  EXPECT_LT(shiny, 0.25);
  config.simulation->specular = 0.0;
  EXPECT_EQ(invalid(0.01, 1.0), 0.0);
  // From 82 degrees off its normal.
  config.simulation->cameras[0].look_at_m = {0.55, 0.0, 0.4};
  config.simulation->cameras[0].position_m = {0.55 + 0.8 * 0.139, 0.8 * 0.990, 0.4};
  EXPECT_GT(invalid(0.01, 1.0), 0.95);
}

TEST_P(Depth, TooNearIsNothing) {
  CellConfig config = test::kinectSimCell(GetParam());
  depthOf(config).nearest_m = 1.5;
  config.simulation->specular = 0.0;
  Cell cell(config, 1);
  const Seen seen = look(cell, config);
  const Eigen::Vector3d centre = seen.iMo.translation();
  const cv::Vec3d pixel = seen.matrix * cv::Vec3d(centre.x() / centre.z(), centre.y() / centre.z(), 1.0);
  EXPECT_EQ(seen.image.at<std::uint16_t>(static_cast<int>(pixel[1]), static_cast<int>(pixel[0])), 0);
}

// Black squares send less light back; time of flight reads them farther.
TEST(TimeOfFlightDepth, BlackMeasuresFarther) {
  CellConfig config = test::kinectSimCell(DepthSensor::kTimeOfFlight);
  fixGeometry(config);
  removeErrors(config);
  removeNoise(config);
  config.simulation->specular = 0.0;
  depthOf(config).black_m = 0.010;
  std::get<Checkerboard>(config.board.pattern).hollow_corner = false;
  const auto blackMinusWhite = [&] {
    Cell cell(config, 1);
    const Seen seen = look(cell, config);
    double sum[2] = {};
    int count[2] = {};
    for (int v = 0; v < seen.image.rows; ++v) {
      for (int u = 0; u < seen.image.cols; ++u) {
        const auto [z, on_board] = seen.plane(u, v);
        // Squares of 7 x 5, corner ones black; only their middles.
        const double x = on_board.x() / 0.03 + 3.5, y = on_board.y() / 0.03 + 2.5;
        if (x < 0 || y < 0 || x >= 7 || y >= 5) continue;
        if (std::abs(x - std::floor(x) - 0.5) > 0.2 || std::abs(y - std::floor(y) - 0.5) > 0.2) continue;
        const int white = (static_cast<int>(x) + static_cast<int>(y)) % 2;
        sum[white] += 0.001 * seen.image.at<std::uint16_t>(v, u) - z;
        ++count[white];
      }
    }
    return sum[0] / count[0] - sum[1] / count[1];
  };
  EXPECT_NEAR(blackMinusWhite(), 0.010, 0.0007);
  SimulationFault inkjet;
  inkjet.kind = FaultKind::kInkjetPrint;  // No black there for infrared.
  config.simulation->faults = {inkjet};
  EXPECT_NEAR(blackMinusWhite(), 0.0, 0.0005);
}

TEST_P(Depth, FaultOfTheUnit) {
  CellConfig config = test::kinectSimCell(GetParam());
  const auto median = [&] {
    Cell cell(config, 1);
    const cv::Mat image = look(cell, config).image;
    std::vector<std::uint16_t> values(image.begin<std::uint16_t>(), image.end<std::uint16_t>());
    std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
    return static_cast<double>(values[values.size() / 2]);
  };
  const double right = median();
  SimulationFault fault;
  fault.kind = FaultKind::kDepthUnit;
  fault.camera = kCamera;
  fault.unit_m = 0.0001;
  config.simulation->faults = {fault};
  EXPECT_NEAR(median() / right, 10.0, 0.05);
}

INSTANTIATE_TEST_SUITE_P(Kinects, Depth,
                         ::testing::Values(DepthSensor::kTimeOfFlight, DepthSensor::kStructuredLight),
                         [](const auto& kinect) { return toString(kinect.param); });

}  // namespace
}  // namespace servocal::sim
