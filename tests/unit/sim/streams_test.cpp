// SPDX-License-Identifier: GPL-3.0-or-later
// Streams of an RGB-D camera: their times, their clocks, and those that exclude each other.
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "default_sim.h"
#include "sim_truth.h"

namespace servocal::sim {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr const char* kCamera = "front";

sensor::Frame nextFrame(Cell& cell, Stream stream) {
  return cell.camera(kCamera).next(stream, cell.clock().now() + seconds(2)).value();
}

TEST(Streams, InfraredAndDepthAreTheSameExposures) {
  Cell cell(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  ASSERT_EQ(cell.camera(kCamera).info().streams.size(), 3u);
  for (int i = 0; i < 5; ++i) {
    const sensor::Frame infrared = nextFrame(cell, Stream::kInfrared);
    const sensor::Frame depth = nextFrame(cell, Stream::kDepth);  // It came with the other.
    EXPECT_EQ(infrared.stream, Stream::kInfrared);
    EXPECT_EQ(depth.stream, Stream::kDepth);
    EXPECT_EQ(infrared.stamp, depth.stamp);
    EXPECT_EQ(infrared.device_stamp_s, depth.device_stamp_s);
    EXPECT_EQ(infrared.sequence, depth.sequence);
    EXPECT_EQ(infrared.received, cell.clock().now());
    EXPECT_EQ(depth.image.size(), cv::Size(512, 424));
  }
}

TEST(Streams, ColorAndInfraredAreNotExposedTogether) {
  Cell cell(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  const double apart = std::fmod(
      toSeconds(nextFrame(cell, Stream::kInfrared).stamp - nextFrame(cell, Stream::kColor).stamp) + 1.0,
      1.0 / 30.0);
  EXPECT_GT(apart, 1e-4);
}

TEST(Streams, ReadingOneLeavesTheOthersAsTheyAre) {
  const CellConfig config = test::kinectSimCell(DepthSensor::kTimeOfFlight);
  Cell all(config, 4), one(config, 4);
  for (int i = 0; i < 3; ++i) {
    nextFrame(all, Stream::kInfrared);
    nextFrame(all, Stream::kDepth);
    nextFrame(all, Stream::kColor);
  }
  one.clock().sleepUntil(all.clock().now());
  for (const Stream stream : {Stream::kColor, Stream::kInfrared, Stream::kDepth}) {
    all.clock().sleepFor(milliseconds(40));
    one.clock().sleepFor(milliseconds(40));
    EXPECT_EQ(cv::norm(nextFrame(all, stream).image, nextFrame(one, stream).image, cv::NORM_INF), 0.0);
  }
}

// The device counts seconds of its own: an offset, and a rate that is off by some parts per million.
TEST(Streams, DeviceClockDrifts) {
  const CellConfig config = test::kinectSimCell(DepthSensor::kTimeOfFlight);
  double fastest = 0.0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Cell cell(config, seed);
    const sensor::Frame first = nextFrame(cell, Stream::kDepth);
    cell.clock().sleepFor(seconds(1000));
    const sensor::Frame last = nextFrame(cell, Stream::kInfrared);
    const double elapsed_s = toSeconds(last.stamp - first.stamp);
    const double drift_ppm = 1e6 * ((last.device_stamp_s - first.device_stamp_s) / elapsed_s - 1.0);
    EXPECT_LE(std::abs(drift_ppm), 20.01);
    EXPECT_GT(first.device_stamp_s, 99.0);
    fastest = std::max(fastest, std::abs(drift_ppm));
  }
  EXPECT_GT(fastest, 10.0);
}

TEST(Streams, DeliveryJitters) {
  CellConfig config = test::kinectSimCell(DepthSensor::kTimeOfFlight);
  const SimulatedCameraConfig& camera = config.simulation->cameras[0];
  config.simulation->cameras[0].delivery_jitter_s = 0.008;
  Cell cell(config, 1);
  double least = 1.0, most = 0.0;
  for (int i = 0; i < 40; ++i) {
    const sensor::Frame frame = nextFrame(cell, Stream::kColor);
    EXPECT_EQ(frame.sequence, static_cast<std::uint64_t>(i));
    const double late = toSeconds(frame.received - frame.stamp) - 0.5 * camera.exposure_s - camera.latency_s;
    least = std::min(least, late);
    most = std::max(most, late);
  }
  EXPECT_GE(least, -1e-8);
  EXPECT_LT(least, 0.002);
  EXPECT_LE(most, 0.008);
  EXPECT_GT(most, 0.006);
}

TEST(ExclusiveStreams, SwitchingTakesItsTime) {
  const CellConfig config = test::kinectSimCell(DepthSensor::kStructuredLight);
  Cell cell(config, 1);
  nextFrame(cell, Stream::kColor);
  const Instant asked = cell.clock().now();
  // Nothing within the time of switching, though a color frame would be there.
  EXPECT_FALSE(cell.camera(kCamera).next(Stream::kInfrared, asked + milliseconds(280)));
  const sensor::Frame infrared = nextFrame(cell, Stream::kInfrared);
  EXPECT_GT(toSeconds(infrared.stamp - asked), 0.3);
  EXPECT_LT(toSeconds(infrared.stamp - asked), 0.3 + 1.0 / 30.0 + 0.011);
  // Depth goes with infrared: no switch.
  EXPECT_EQ(nextFrame(cell, Stream::kDepth).stamp, infrared.stamp);
  const Instant back = cell.clock().now();
  const sensor::Frame color = nextFrame(cell, Stream::kColor);
  EXPECT_GT(toSeconds(color.stamp - back), 0.3);
  const sensor::Frame next = nextFrame(cell, Stream::kColor);
  EXPECT_EQ(next.sequence, color.sequence + 1);
}

TEST(ExclusiveStreams, AKinectV2RunsBoth) {
  Cell cell(test::kinectSimCell(DepthSensor::kTimeOfFlight), 1);
  nextFrame(cell, Stream::kColor);
  const Instant asked = cell.clock().now();
  EXPECT_LT(toSeconds(nextFrame(cell, Stream::kInfrared).received - asked), 1.0 / 30.0 + 1e-6);
}

TEST(Streams, RefusesStreamsThatAreNotThere) {
  CellConfig config = test::kinectSimCell(DepthSensor::kTimeOfFlight);
  config.cameras[0].infrared->depth.reset();
  Cell cell(config, 1);
  EXPECT_NO_THROW(nextFrame(cell, Stream::kInfrared));
  EXPECT_THROW(nextFrame(cell, Stream::kDepth), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::sim
