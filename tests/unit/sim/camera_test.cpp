// SPDX-License-Identifier: GPL-3.0-or-later
// The simulated camera through its public interface: timing, determinism, laziness.
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "default_sim.h"
#include "motion_key.h"
#include "sim_truth.h"

namespace servocal::sim {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr const char* kCamera = "front";

sensor::Frame nextFrame(Cell& cell) {
  auto frame = cell.camera(kCamera).next(Stream::kColor, cell.clock().now() + seconds(1));
  EXPECT_TRUE(frame.has_value());
  return frame.value();
}

bool sameBytes(const cv::Mat& first, const cv::Mat& second) {
  return first.size() == second.size() && cv::norm(first, second, cv::NORM_INF) == 0.0;
}

// Steepest change of gray across the board: blur lowers it.
double sharpness(const cv::Mat& image, const std::vector<Eigen::Vector2d>& corners) {
  std::vector<cv::Point2f> points;
  for (const Eigen::Vector2d& corner : corners) points.emplace_back(corner.x(), corner.y());
  cv::Mat smooth, gradient;
  cv::GaussianBlur(image(cv::boundingRect(points)), smooth, cv::Size(5, 5), 1.0);
  cv::Sobel(smooth, gradient, CV_32F, 1, 0);
  return cv::norm(gradient, cv::NORM_L2) / std::sqrt(static_cast<double>(gradient.total()));
}

TEST(SimulatedCamera, FramesComeInTime) {
  const CellConfig config = test::defaultSimCell();
  const SimulatedCameraConfig& camera = config.simulation->cameras[0];
  Cell cell(config, 1);
  for (std::uint64_t k = 0; k < 4; ++k) {
    const sensor::Frame frame = nextFrame(cell);
    EXPECT_EQ(frame.sequence, k);
    const double begin_s = static_cast<double>(k) / camera.rate_hz;
    EXPECT_NEAR(toSeconds(frame.stamp), begin_s + 0.5 * camera.exposure_s, 1e-8);
    EXPECT_NEAR(toSeconds(frame.received), begin_s + camera.exposure_s + camera.latency_s, 1e-8);
    EXPECT_EQ(cell.clock().now(), frame.received);
    EXPECT_EQ(frame.image.type(), CV_8UC1);
    EXPECT_EQ(frame.image.size(), cv::Size(1920, 1080));
  }
}

TEST(SimulatedCamera, HandsOutTheNewestFrameAndDropsOlderOnes) {
  Cell cell(test::defaultSimCell(), 1);
  cell.clock().sleepUntil(Instant(seconds(2)));
  const sensor::Frame frame = nextFrame(cell);
  EXPECT_EQ(cell.clock().now(), Instant(seconds(2)));  // It was there already.
  EXPECT_LE(frame.received, cell.clock().now());
  EXPECT_GT(frame.received, cell.clock().now() - milliseconds(34));
  EXPECT_EQ(nextFrame(cell).sequence, frame.sequence + 1);
}

TEST(SimulatedCamera, WaitsNoLongerThanTheDeadline) {
  Cell cell(test::defaultSimCell(), 1);
  EXPECT_FALSE(cell.camera(kCamera).next(Stream::kColor, Instant(milliseconds(50))));
  EXPECT_EQ(cell.clock().now(), Instant(milliseconds(50)));
  EXPECT_FALSE(cell.camera(kCamera).next(Stream::kColor, Instant(milliseconds(10))));
  EXPECT_EQ(cell.clock().now(), Instant(milliseconds(50)));
  EXPECT_TRUE(cell.camera(kCamera).next(Stream::kColor, Instant(milliseconds(66))));
}

TEST(SimulatedCamera, RendersOnlyWhatIsRead) {
  Cell cell(test::defaultSimCell(), 1);
  const Truth truth(cell);
  cell.clock().sleepUntil(Instant(seconds(100)));
  cell.camera(kCamera).info();
  EXPECT_EQ(truth.framesRendered(kCamera), 0);
  nextFrame(cell);
  EXPECT_EQ(truth.framesRendered(kCamera), 1);
  EXPECT_FALSE(cell.camera(kCamera).next(Stream::kColor, cell.clock().now()));
  EXPECT_EQ(truth.framesRendered(kCamera), 1);
}

TEST(SimulatedCamera, SameSeedAndCallsGiveTheSameBytes) {
  const CellConfig config = test::defaultSimCell();
  Cell first(config, 7), second(config, 7), other(config, 8);
  const Twist<Base> twist{{0.0, 0.1, 0.05}, {0.1, 0.0, 0.0}};
  for (int i = 0; i < 3; ++i) {
    for (Cell* cell : {&first, &second, &other}) {
      cell->arm().move(test::forgedMotionKey(), twist, milliseconds(100));
    }
    const sensor::Frame a = nextFrame(first), b = nextFrame(second), c = nextFrame(other);
    EXPECT_TRUE(sameBytes(a.image, b.image)) << i;
    EXPECT_EQ(a.device_stamp_s, b.device_stamp_s);
    EXPECT_FALSE(sameBytes(a.image, c.image)) << i;
    EXPECT_EQ(first.arm().state().q, second.arm().state().q);
  }
}

TEST(SimulatedCamera, FramesReadInBetweenDoNotChangeAFrame) {
  const CellConfig config = test::defaultSimCell();
  Cell eager(config, 3), lazy(config, 3);
  for (int i = 0; i < 5; ++i) nextFrame(eager);
  lazy.clock().sleepUntil(eager.clock().now());
  eager.clock().sleepFor(milliseconds(40));
  lazy.clock().sleepFor(milliseconds(40));
  EXPECT_TRUE(sameBytes(nextFrame(eager).image, nextFrame(lazy).image));
}

TEST(SimulatedCamera, EverySeedIsAnotherCell) {
  const CellConfig config = test::defaultSimCell();
  Cell first(config, 1), second(config, 2);
  const Truth a(first), b(second);
  EXPECT_NE(a.camera(kCamera).parameters, b.camera(kCamera).parameters);
  EXPECT_GT(distanceM(a.bMc(kCamera), b.bMc(kCamera)), 1e-3);
  EXPECT_GT(angleRad(a.eMo(), b.eMo()), 1e-2);
}

TEST(SimulatedCamera, DrawsStayWithinTheirSpreads) {
  const CellConfig config = test::defaultSimCell();
  const SimulationConfig& simulation = *config.simulation;
  double largest_turn = 0.0, largest_shift = 0.0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    Cell cell(config, seed);
    const Truth truth(cell);
    const double turn = angleRad(truth.eMo(), simulation.nominal_eMo);
    const double shift = distanceM(truth.eMo(), simulation.nominal_eMo);
    EXPECT_LE(turn, simulation.mount_rotation_spread_rad + 1e-9);
    EXPECT_LE(shift, simulation.mount_translation_spread_m + 1e-9);
    largest_turn = std::max(largest_turn, turn);
    largest_shift = std::max(largest_shift, shift);
    const SimulatedCameraConfig& camera = simulation.cameras[0];
    const Eigen::Vector3d moved = truth.bMc(kCamera).translation() - camera.position_m;
    EXPECT_LE(moved.cwiseAbs().maxCoeff(), camera.position_spread_m + 1e-9);
    // Looks along -x of the base, image x along +y, image y down.
    Eigen::Matrix3d upright;
    upright << 0, 0, -1, 1, 0, 0, 0, -1, 0;
    EXPECT_LE(Eigen::AngleAxisd(upright.transpose() * truth.bMc(kCamera).rotation()).angle(),
              camera.rotation_spread_rad + 1e-9);
  }
  EXPECT_GT(largest_turn, 0.9 * simulation.mount_rotation_spread_rad);
  EXPECT_GT(largest_shift, 0.9 * simulation.mount_translation_spread_m);
}

TEST(SimulatedCamera, AMovingArmBlursTheImage) {
  Cell cell(test::defaultSimCell(), 1);
  const Truth truth(cell);
  const auto frameSharpness = [&] {
    const sensor::Frame frame = nextFrame(cell);
    return sharpness(frame.image, truth.corners(kCamera, frame.stamp));
  };
  const double still = frameSharpness(), still_again = frameSharpness();
  for (int i = 0; i < 10; ++i) {
    cell.arm().move(test::forgedMotionKey(), {{0.0, 0.2, 0.0}, {0.0, 0.0, 0.0}}, milliseconds(100));
    nextFrame(cell);
  }
  const double moving = frameSharpness();
  cell.clock().sleepFor(milliseconds(500));
  const double still_after = frameSharpness();
  EXPECT_NEAR(still_again / still, 1.0, 0.02);
  EXPECT_LT(moving, 0.8 * still);
  EXPECT_GT(still_after, 0.9 * still);
}

TEST(SimulatedCamera, RefusesWhatIsNotThere) {
  CellConfig config = test::defaultSimCell();
  Cell cell(config, 1);
  EXPECT_THROW(cell.camera("side"), std::invalid_argument);
  EXPECT_THROW(cell.camera(kCamera).next(Stream::kDepth, Instant(seconds(1))), std::invalid_argument);
  config.simulation->cameras[0].name = "side";
  EXPECT_THROW(Cell(config, 1), std::invalid_argument);
  config = test::defaultSimCell();
  config.cameras[0].mount = Mount::kFlange;
  EXPECT_THROW(Cell(config, 1), std::invalid_argument);
  config = test::defaultSimCell();
  config.simulation->cameras[0].rate_hz = 0.0;
  EXPECT_THROW(Cell(config, 1), std::invalid_argument);
  config.simulation.reset();
  EXPECT_THROW(Cell(config, 1), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::sim
