// SPDX-License-Identifier: GPL-3.0-or-later
// Faults of the simulated cell: each does what it says, when it says, and nothing else. Those of the infrared
// print and of the depth unit are tested with their images.
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "default_sim.h"
#include "sim_truth.h"

namespace servocal::sim {
namespace {

using std::chrono::seconds;

constexpr const char* kCamera = "front";

CellConfig cellWith(const SimulationFault& fault) {
  CellConfig config = test::kinectSimCell(DepthSensor::kTimeOfFlight);
  config.simulation->faults = {fault};
  return config;
}

SimulationFault fault(FaultKind kind, const std::string& camera = "") {
  SimulationFault fault;
  fault.kind = kind;
  fault.camera = camera;
  return fault;
}

sensor::Frame nextFrame(Cell& cell, Stream stream) {
  return cell.camera(kCamera).next(stream, cell.clock().now() + seconds(2)).value();
}

TEST(Faults, MountSlipsOnceInTheFlangesFrame) {
  SimulationFault slip = fault(FaultKind::kMountSlip);
  slip.at_s = 5.0;
  slip.translation_m = {0.003, 0.0, 0.0};
  slip.rotation_rad = {0.0, 0.0, 0.02};
  Cell cell(cellWith(slip), 1);
  const Truth truth(cell);
  const Pose<EndEffector, Board> before = truth.eMo();
  cell.clock().sleepUntil(Instant(std::chrono::milliseconds(4999)));
  EXPECT_EQ(distanceM(truth.eMo(), before), 0.0);
  cell.clock().sleepUntil(Instant(seconds(5)));
  const Pose<EndEffector, Board> after = truth.eMo();
  EXPECT_LT((after.translation() - before.translation() - Eigen::Vector3d(0.003, 0, 0)).norm(), 1e-12);
  EXPECT_NEAR(angleRad(after, before), 0.02, 1e-9);
  // The past stays what it was, and images show the change.
  EXPECT_EQ(distanceM(truth.eMo(Instant(seconds(4))), before), 0.0);
  const auto early = truth.corners(kCamera, Instant(seconds(4))),
             late = truth.corners(kCamera, Instant(seconds(6)));
  EXPECT_GT((late[0] - early[0]).norm(), 2.0);
}

TEST(Faults, ImagesFollowTheMount) {
  SimulationFault slip = fault(FaultKind::kMountSlip);
  slip.at_s = 1.0;
  slip.translation_m = {0.003, 0.0, 0.0};
  Cell slipped(cellWith(slip), 1), sound(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  for (const Stream stream : {Stream::kColor, Stream::kInfrared, Stream::kDepth}) {
    const cv::Mat a = nextFrame(slipped, stream).image, b = nextFrame(sound, stream).image;
    EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0.0) << toString(stream);
  }
  slipped.clock().sleepUntil(Instant(seconds(2)));
  sound.clock().sleepUntil(Instant(seconds(2)));
  for (const Stream stream : {Stream::kColor, Stream::kInfrared, Stream::kDepth}) {
    const cv::Mat a = nextFrame(slipped, stream).image, b = nextFrame(sound, stream).image;
    EXPECT_GT(cv::norm(a, b, cv::NORM_INF), 50.0) << toString(stream);
  }
}

TEST(Faults, CameraIsBumpedInItsOwnAxes) {
  SimulationFault bump = fault(FaultKind::kCameraBump, kCamera);
  bump.at_s = 3.0;
  bump.translation_m = {0.0, 0.0, 0.02};
  bump.rotation_rad = {0.0, 0.05, 0.0};
  Cell cell(cellWith(bump), 1);
  const Truth truth(cell);
  const Pose<Base, Color> before = truth.bMc(kCamera, Instant(seconds(2)));
  const Pose<Base, Color> after = truth.bMc(kCamera, Instant(seconds(3)));
  const Pose<Color, Color> moved = before.inverse() * after;
  EXPECT_LT((moved.translation() - bump.translation_m).norm(), 1e-12);
  EXPECT_LT((moved.rotationVector() - bump.rotation_rad).norm(), 1e-9);
}

TEST(Faults, CameraTurnedAwayNeverSeesTheBoard) {
  Cell cell(cellWith(fault(FaultKind::kCameraTurnedAway, kCamera)), 1);
  Cell sound(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  const Truth away(cell), there(sound);
  EXPECT_LT(away.cMo(kCamera, cell.clock().now()).translation().z(), 0.0);
  EXPECT_EQ(distanceM(away.bMc(kCamera), there.bMc(kCamera)), 0.0);
  EXPECT_NEAR(angleRad(away.bMc(kCamera), there.bMc(kCamera)), M_PI, 1e-6);
  const cv::Mat depth = nextFrame(cell, Stream::kDepth).image;
  int near = 0;
  for (auto it = depth.begin<std::uint16_t>(); it != depth.end<std::uint16_t>(); ++it)
    near += *it > 0 && *it < 1500;
  EXPECT_EQ(near, 0);
}

TEST(Faults, ClockOffsetShiftsStampsAlone) {
  SimulationFault clock = fault(FaultKind::kClockOffset, kCamera);
  clock.offset_s = 0.08;
  Cell cell(cellWith(clock), 1), sound(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
    const sensor::Frame wrong = nextFrame(cell, stream), right = nextFrame(sound, stream);
    EXPECT_NEAR(toSeconds(wrong.stamp - right.stamp), 0.08, 1e-9);
    EXPECT_NEAR(wrong.device_stamp_s - right.device_stamp_s, 0.08, 1e-5);
    EXPECT_EQ(wrong.received, right.received);
    EXPECT_EQ(cv::norm(wrong.image, right.image, cv::NORM_INF), 0.0);
  }
}

TEST(Faults, LateDeliveryLeavesStamps) {
  SimulationFault late = fault(FaultKind::kLateDelivery, kCamera);
  late.offset_s = 0.08;
  Cell cell(cellWith(late), 1), sound(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  const sensor::Frame slow = nextFrame(cell, Stream::kColor), right = nextFrame(sound, Stream::kColor);
  EXPECT_EQ(slow.stamp, right.stamp);
  EXPECT_EQ(slow.device_stamp_s, right.device_stamp_s);
  EXPECT_NEAR(toSeconds(slow.received - right.received), 0.08, 1e-9);
}

TEST(Faults, ExposureChangesGraysAloneAndFromItsTimeOn) {
  SimulationFault dark = fault(FaultKind::kExposure, kCamera);
  dark.at_s = 1.0;
  dark.gain = 0.25;
  Cell cell(cellWith(dark), 1), sound(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  for (const double gain : {1.0, 0.25}) {
    for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
      const sensor::Frame wrong = nextFrame(cell, stream), right = nextFrame(sound, stream);
      EXPECT_EQ(wrong.stamp, right.stamp);
      cv::Mat expected;
      right.image.convertTo(expected, -1, gain);
      EXPECT_EQ(cv::norm(wrong.image, expected, cv::NORM_INF), 0.0) << toString(stream);
    }
    cell.clock().sleepUntil(Instant(seconds(2)));
    sound.clock().sleepUntil(Instant(seconds(2)));
  }
  EXPECT_EQ(
      cv::norm(nextFrame(cell, Stream::kDepth).image, nextFrame(sound, Stream::kDepth).image, cv::NORM_INF),
      0.0);
}

TEST(Faults, FlickerIsDrawnForEachFrame) {
  SimulationFault flicker = fault(FaultKind::kExposure, kCamera);
  flicker.flicker = 0.5;
  Cell cell(cellWith(flicker), 1), sound(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  double least = 10.0, most = 0.0;
  for (int i = 0; i < 8; ++i) {
    const double gain = cv::mean(nextFrame(cell, Stream::kColor).image)[0] /
                        cv::mean(nextFrame(sound, Stream::kColor).image)[0];
    least = std::min(least, gain);
    most = std::max(most, gain);
  }
  EXPECT_GT(least, 0.45);
  EXPECT_LT(least, 0.85);
  EXPECT_GT(most, 1.05);
  EXPECT_LT(most, 1.55);
}

TEST(Faults, SlowFramesComeAtTheirRateFromTheirTimeOn) {
  SimulationFault slow = fault(FaultKind::kSlowFrames, kCamera);
  slow.at_s = 2.0;
  slow.rate_hz = 4.0;
  Cell cell(cellWith(slow), 1), sound(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  const auto count = [](Cell& its_cell, int until_s) {
    int frames = 0;
    std::uint64_t last = 0;
    while (const auto frame = its_cell.camera(kCamera).next(Stream::kColor, Instant(seconds(until_s)))) {
      EXPECT_TRUE(frames == 0 || frame->sequence > last);
      last = frame->sequence;
      ++frames;
    }
    return frames;
  };
  EXPECT_EQ(count(cell, 2), count(sound, 2));
  EXPECT_NEAR(count(cell, 4), 8, 2);
  EXPECT_EQ(cell.camera(kCamera).info().streams[0].rate_hz, sound.camera(kCamera).info().streams[0].rate_hz);
}

TEST(Faults, RefusesCamerasThatAreNotThere) {
  EXPECT_THROW(Cell(cellWith(fault(FaultKind::kCameraTurnedAway, "side")), 1), std::invalid_argument);
  CellConfig config = test::defaultSimCell();
  config.simulation->faults = {fault(FaultKind::kDepthUnit, kCamera)};
  EXPECT_THROW(Cell(config, 1), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::sim
