// SPDX-License-Identifier: GPL-3.0-or-later
// The difficulty of the simulated cell is part of the specification: it is measured here from what the
// cell hands out, by OpenCV's finder and the truth. Making the cell easier fails these tests.
#include <gtest/gtest.h>

#include <iostream>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "default_sim.h"
#include "motion_key.h"
#include "random.h"
#include "sim_truth.h"

namespace servocal::sim {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr const char* kCamera = "front";

/// The default cell with the camera moved back until a square is 15 px wide, and a plain board: OpenCV's
/// finder takes the hollow square for a smaller one, and its inner edges pull at corner 0.
CellConfig farCell() {
  CellConfig config = test::defaultSimCell();
  std::get<Checkerboard>(config.board.pattern).hollow_corner = false;
  SimulatedCameraConfig& camera = config.simulation->cameras[0];
  camera.position_m.x() = 0.55 + config.board.spacing() * camera.focal_px / 15.0;
  return config;
}

struct CornerNoise {
  double rms_px = 0.0;  ///< Per axis, against the truth.
  Eigen::Vector2d mean_px = Eigen::Vector2d::Zero();
  double square_px = 0.0;
  double found = 0.0;   ///< Share of corners found within 3 px of the truth.
};

CornerNoise measureCorners(const CellConfig& config) {
  double sum = 0.0, square = 0.0;
  int measured = 0, expected = 0, frames = 0;
  CornerNoise noise;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Cell cell(config, seed);
    const Truth truth(cell);
    for (int k = 0; k < 4; ++k) {
      const auto frame = cell.camera(kCamera).next(Stream::kColor, cell.clock().now() + seconds(1)).value();
      const std::vector<Eigen::Vector2d> corners = truth.corners(kCamera, frame.stamp);
      square += (corners[1] - corners[0]).norm();
      ++frames;
      expected += static_cast<int>(corners.size());
      std::vector<cv::Point2f> found;
      if (!cv::findChessboardCorners(frame.image, cv::Size(6, 4), found)) continue;
      cv::cornerSubPix(frame.image, found, cv::Size(5, 5), cv::Size(-1, -1),
                       cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-4));
      for (const cv::Point2f& point : found) {
        Eigen::Vector2d nearest(1e9, 1e9);
        for (const Eigen::Vector2d& corner : corners) {
          const Eigen::Vector2d error = Eigen::Vector2d(point.x, point.y) - corner;
          if (error.norm() < nearest.norm()) nearest = error;
        }
        if (nearest.norm() > 3.0) continue;
        sum += nearest.squaredNorm();
        noise.mean_px += nearest;
        ++measured;
      }
    }
  }
  noise.rms_px = std::sqrt(sum / (2.0 * measured));
  noise.mean_px /= measured;
  noise.square_px = square / frames;
  noise.found = static_cast<double>(measured) / expected;
  return noise;
}

TEST(Difficulty, CornerNoiseIsThatOfARealCamera) {
  const CornerNoise noise = measureCorners(farCell());
  std::cout << "corner noise " << noise.rms_px << " px at " << noise.square_px << " px squares, mean "
            << noise.mean_px.transpose() << ", found " << noise.found << '\n';
  EXPECT_NEAR(noise.square_px, 15.0, 1.0);
  EXPECT_GE(noise.rms_px, 0.10);
  EXPECT_LE(noise.rms_px, 0.30);
  EXPECT_LT(noise.mean_px.cwiseAbs().maxCoeff(), 0.02);
  EXPECT_GE(noise.found, 0.9);
}

// Negative control: an easy camera is noticed.
TEST(Difficulty, MeasureSeesAnEasyCamera) {
  CellConfig config = farCell();
  config.simulation->cameras[0].noise_gray = 1.0;
  EXPECT_LT(measureCorners(config).rms_px, 0.08);
}

TEST(Difficulty, LensIsDistorted) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Cell cell(test::defaultSimCell(), seed);
    EXPECT_GE(std::abs(Truth(cell).camera(kCamera).parameters[4]), 0.04);
  }
}

TEST(Difficulty, FramesAreLate) {
  Cell cell(test::defaultSimCell(), 1);
  const auto frame = cell.camera(kCamera).next(Stream::kColor, Instant(seconds(1))).value();
  const double exposure_s = test::defaultSimCell().simulation->cameras[0].exposure_s;
  EXPECT_NEAR(toSeconds(frame.stamp), 0.5 * exposure_s, 1e-9);  // Frame 0 is exposed from 0 on.
  EXPECT_GE(toSeconds(frame.received), 0.060);
}

// How far the flange is from what the arm reports, beyond what stays the same from visit to visit.
TEST(Difficulty, ArmDoesNotComeBackToTheSamePlace) {
  Cell cell(test::defaultSimCell(), 5);
  const Truth truth(cell);
  std::vector<Eigen::Vector3d> positions;
  std::vector<Eigen::Vector3d> rotations;
  const auto drive = [&](double y_mps) {
    cell.arm().move(test::forgedMotionKey(), {{0.0, y_mps, 0.0}, Eigen::Vector3d::Zero()}, milliseconds(400));
    cell.clock().sleepFor(milliseconds(600));
  };
  for (int visit = 0; visit < 300; ++visit) {
    drive(0.2);
    drive(-0.2);
    const RobotState state = cell.arm().state();
    positions.push_back(truth.bMe().translation() - state.bMe.translation());
    rotations.push_back(
        (Pose<Base, EndEffector>(truth.bMe().rotation() * state.bMe.rotation().transpose(), {0, 0, 0}))
            .rotationVector());
  }
  const auto scatter = [](const std::vector<Eigen::Vector3d>& values) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& value : values) mean += value / values.size();
    double sum = 0.0;
    for (const Eigen::Vector3d& value : values) sum += (value - mean).squaredNorm();
    return std::sqrt(sum / values.size());
  };
  EXPECT_NEAR(scatter(positions), 1e-4, 1.5e-5);
  EXPECT_NEAR(scatter(rotations), 0.02 * M_PI / 180.0, 0.003 * M_PI / 180.0);
  // Standing still, it does stay.
  const Pose<Base, EndEffector> before = truth.bMe();
  cell.clock().sleepFor(seconds(5));
  EXPECT_EQ(distanceM(before, truth.bMe()), 0.0);
}

// RMS distance between the reported and the true flange, over configurations whose flange is in the
// workspace box, with repeatability off: one seed starts every configuration with the same draw of it,
// which would not average out. Nothing is fitted away.
TEST(Difficulty, ArmIsOffOverTheVolume) {
  CellConfig config = test::defaultSimCell();
  config.simulation->repeatability_m = 0.0;
  config.simulation->repeatability_rad = 0.0;
  Random random(9, "test configurations");
  double sum = 0.0;
  int count = 0;
  while (count < 300) {
    for (double& angle : config.arm.start_q) angle = random.uniform(-M_PI, M_PI);
    Cell cell(config, 1);
    const RobotState state = cell.arm().state();
    if (!config.limits.workspace.contains(state.bMe.translation())) continue;
    sum += (Truth(cell).bMe().translation() - state.bMe.translation()).squaredNorm();
    ++count;
  }
  EXPECT_NEAR(std::sqrt(sum / count), 3e-4, 3e-5);
}

TEST(Difficulty, MountIsUnknownByThirtyDegreesAndFiftyMillimetres) {
  const SimulationConfig simulation = *test::defaultSimCell().simulation;
  EXPECT_GE(simulation.mount_rotation_spread_rad, 29.7 * M_PI / 180.0);
  EXPECT_GE(simulation.mount_translation_spread_m, 0.05);
}

}  // namespace
}  // namespace servocal::sim
