// SPDX-License-Identifier: GPL-3.0-or-later
// Our backend, the real libOpenNI2, our driver below it, and the simulated cell at the bottom: what comes out
// on top is compared with the same cell read directly.
#include "servocal/sensor_openni2/camera.h"

#include <OpenNI.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "errors.h"
#include "plugged.h"

namespace servocal::openni2 {
namespace {

using sim_openni2_driver::Served;
using std::chrono::milliseconds;
using test::expectPart;
using test::kinect;
using test::Plugged;
using test::raw;

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0.0;
}

cv::Mat inThree(const cv::Mat& gray) {
  cv::Mat color;
  cv::cvtColor(gray, color, cv::COLOR_GRAY2BGR);
  return color;
}

cv::Mat inTenBits(const cv::Mat& gray) {
  cv::Mat counts;
  gray.convertTo(counts, CV_16U, 4.0);
  return counts;
}

/// What the cell itself delivers as the frame of this number.
sensor::Frame direct(sim::Cell& cell, const std::string& camera, Stream stream, std::uint64_t number) {
  for (;;) {
    auto frame = cell.camera(camera).next(stream, cell.clock().now() + std::chrono::seconds(3));
    if (frame && frame->sequence >= number) return *frame;
  }
}

TEST(OpenNi2, ListsWhatIsPluggedIn) {
  const Plugged plugged(kinect(DepthSensor::kTimeOfFlight));
  const auto list = devices();
  ASSERT_EQ(list.size(), 1u);
  EXPECT_EQ(list[0].uri, "servocal://front");
  EXPECT_EQ(list[0].vendor, "servocal");
  EXPECT_EQ(list[0].serial, "sim-front-3");
}

TEST(OpenNi2, EveryStreamIsTheSimulatedOneBitByBit) {
  for (const DepthSensor sensor : {DepthSensor::kTimeOfFlight, DepthSensor::kStructuredLight}) {
    SCOPED_TRACE(toString(sensor));
    const CellConfig config = kinect(sensor);
    Plugged plugged(config);
    const auto opened = openCamera(config.cameras[0], plugged.cell.clock(), raw());
    sensor::RgbdCamera& camera = *opened.camera;
    EXPECT_EQ(camera.info().serial, "sim-front-3");
    ASSERT_EQ(camera.info().streams.size(), 3u);
    EXPECT_EQ(camera.info().streams[0].rate_hz, 30.0);
    for (const Stream stream : {Stream::kColor, Stream::kInfrared, Stream::kDepth, Stream::kColor}) {
      SCOPED_TRACE(toString(stream));
      const auto frame = camera.next(stream, plugged.cell.clock().now() + std::chrono::seconds(2));
      ASSERT_TRUE(frame);
      // Another cell, so that no frame is asked for twice; the frames' numbers are the simulator's own.
      sim::Cell other(config, test::kSeed);
      // The stamp names the frame: numbers begin again with each stream.
      sensor::Frame expected;
      do {
        expected = direct(other, "front", stream, 0);
      } while (std::abs(expected.device_stamp_s - frame->device_stamp_s) > 1e-5 &&
               expected.device_stamp_s < frame->device_stamp_s);
      EXPECT_NEAR(expected.device_stamp_s, frame->device_stamp_s, 1e-6);
      // All that is left is what the nominal latency of 55 ms is off by for this stream.
      const double latency_s = toSeconds(expected.received - expected.stamp);
      EXPECT_NEAR(toSeconds(frame->stamp - expected.stamp), latency_s - 0.055, 0.0015);
      switch (stream) {
        case Stream::kColor: EXPECT_TRUE(same(frame->image, inThree(expected.image))); break;
        case Stream::kInfrared: EXPECT_TRUE(same(frame->image, inTenBits(expected.image))); break;
        case Stream::kDepth:
          EXPECT_TRUE(same(frame->image, expected.image));
          EXPECT_GT(cv::countNonZero(frame->image), 1000);
          break;
      }
    }
  }
}

TEST(OpenNi2, InfraredIsMadeForDetectorsUnlessRawIsAskedFor) {
  const CellConfig config = kinect(DepthSensor::kTimeOfFlight);
  Plugged plugged(config);
  const auto opened = openCamera(config.cameras[0], plugged.cell.clock());
  const auto frame = opened.camera->next(Stream::kInfrared, Instant(std::chrono::seconds(1)));
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->image.type(), CV_8UC1);
}

TEST(OpenNi2, DepthInTenthsOfAMillimetreIsTurnedIntoMillimetres) {
  const CellConfig config = kinect(DepthSensor::kTimeOfFlight);
  Served how;
  how.tenth_millimetres = true;
  Plugged plugged(config, how);
  const auto opened = openCamera(config.cameras[0], plugged.cell.clock());
  const auto frame = opened.camera->next(Stream::kDepth, Instant(std::chrono::seconds(1)));
  ASSERT_TRUE(frame);
  sim::Cell other(config, test::kSeed);
  sensor::Frame expected;
  do {
    expected = direct(other, "front", Stream::kDepth, 0);
  } while (expected.device_stamp_s < frame->device_stamp_s - 1e-5);
  EXPECT_TRUE(same(frame->image, expected.image));
}

// Every frame once, in order, at its rate, and the run's clock is the only one that passes.
TEST(OpenNi2, FramesComeAtTheirRateOnTheRunsClock) {
  const CellConfig config = kinect(DepthSensor::kStructuredLight);
  Plugged plugged(config);
  const auto opened = openCamera(config.cameras[0], plugged.cell.clock());
  Clock& clock = plugged.cell.clock();
  std::optional<sensor::Frame> last;
  for (int i = 0; i < 30; ++i) {
    const auto frame = opened.camera->next(Stream::kColor, clock.now() + milliseconds(500));
    ASSERT_TRUE(frame);
    if (last) {
      EXPECT_EQ(frame->sequence, last->sequence + 1);
      EXPECT_NEAR(toSeconds(frame->stamp - last->stamp), 1.0 / 30.0, 0.001);
    }
    EXPECT_NEAR(toSeconds(frame->received - frame->stamp), 0.055, 0.0015);
    last = frame;
  }
  EXPECT_NEAR(toSeconds(clock.now()), 1.05, 0.1);
  // Who does not look for a while gets the newest, not the oldest.
  clock.sleepFor(milliseconds(500));
  const auto frame = opened.camera->next(Stream::kColor, clock.now() + milliseconds(500));
  ASSERT_TRUE(frame);
  EXPECT_LT(toSeconds(clock.now() - frame->stamp), 0.1);
  EXPECT_GE(frame->sequence, last->sequence + 14);
  // And a deadline is kept.
  EXPECT_FALSE(opened.camera->next(Stream::kColor, clock.now() + milliseconds(5)));
}

TEST(OpenNi2, StreamsThatExcludeEachOtherTakeTurns) {
  const CellConfig config = kinect(DepthSensor::kStructuredLight);
  Plugged plugged(config);
  Clock& clock = plugged.cell.clock();
  auto opened = openCamera(config.cameras[0], clock);
  for (int turn = 0; turn < 3; ++turn) {
    for (const Stream stream : {Stream::kColor, Stream::kInfrared, Stream::kDepth}) {
      const Instant asked = clock.now();
      const auto frame = opened.camera->next(stream, asked + std::chrono::seconds(1));
      ASSERT_TRUE(frame) << toString(stream);
      // Nothing that was exposed before the change; depth runs beside infrared.
      if (stream != Stream::kDepth) {
        EXPECT_GE(frame->stamp + milliseconds(2), asked);
      }
    }
  }
  opened.camera.reset();  // One user at a time.
  // Said not to exclude each other, the device's refusal becomes a sentence with the cure.
  CellConfig wrong = config;
  wrong.cameras[0].infrared->excludes_color = false;
  const std::string refusal =
      test::messageOf(ErrorKind::kHardwareAbsent, [&] { (void)openCamera(wrong.cameras[0], clock); });
  expectPart(refusal, "excludes_color: true");
}

TEST(OpenNi2, AnUnpluggedCameraIsNamedAndKnownAgainBySerial) {
  CellConfig config = kinect(DepthSensor::kTimeOfFlight);
  config.cameras[0].device = "sim-front-3";
  Plugged plugged(config);
  Clock& clock = plugged.cell.clock();
  const auto opened = openCamera(config.cameras[0], clock);
  const auto before = opened.camera->next(Stream::kDepth, clock.now() + milliseconds(500));
  ASSERT_TRUE(before);
  plugged.served.unplug("front");
  for (int again = 0; again < 2; ++again) {
    const std::string gone = test::messageOf(ErrorKind::kHardwareAbsent, [&] {
      (void)opened.camera->next(Stream::kDepth, clock.now() + milliseconds(500));
    });
    expectPart(gone, "'front'");
    expectPart(gone, "serial sim-front-3");
    expectPart(gone, "unplugged");
  }
  clock.sleepFor(milliseconds(700));
  plugged.served.plug("front");
  const Instant asked = clock.now();
  const auto after = opened.camera->next(Stream::kDepth, asked + milliseconds(500));
  ASSERT_TRUE(after);
  EXPECT_GT(after->sequence, before->sequence);
  EXPECT_NEAR(toSeconds(after->received - after->stamp), 0.055, 0.035);
  EXPECT_GT(cv::countNonZero(after->image), 1000);  // Set up as before: not registered.
}

TEST(OpenNi2, OneOfSeveralMustBeNamed) {
  CellConfig config = defaultCell();
  Plugged plugged(config);
  Clock& clock = plugged.cell.clock();
  CameraConfig& camera = config.cameras[1];
  const auto refusal = [&] {
    return test::messageOf(ErrorKind::kHardwareAbsent, [&] { (void)openCamera(camera, clock); });
  };
  expectPart(refusal(), "servocal://left");
  expectPart(refusal(), "'device'");
  camera.device = "A00362A01385118A";
  expectPart(refusal(), "sees no device 'A00362A01385118A'");
  expectPart(refusal(), "sim-right-3");
  for (const std::string device : {"sim-right-3", "servocal://right"}) {
    camera.device = device;
    EXPECT_EQ(openCamera(camera, clock).camera->info().serial, "sim-right-3");
  }
}

TEST(OpenNi2, ADeviceWithoutTheModeIsRefusedWithTheModesItHas) {
  CellConfig config = kinect(DepthSensor::kTimeOfFlight);
  Plugged plugged(config);
  config.cameras[0].width_px = 1280;
  config.cameras[0].height_px = 720;
  const std::string refusal = test::messageOf(
      ErrorKind::kHardwareAbsent, [&] { (void)openCamera(config.cameras[0], plugged.cell.clock()); });
  expectPart(refusal, "1280 x 720");
  expectPart(refusal, "1920 x 1080");
  // Half of the size is a mode as well.
  config.cameras[0].width_px = 960;
  config.cameras[0].height_px = 540;
  const auto opened = openCamera(config.cameras[0], plugged.cell.clock());
  const auto frame = opened.camera->next(Stream::kColor, Instant(std::chrono::seconds(1)));
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->image.size(), cv::Size(960, 540));
}

TEST(OpenNi2, AColorCameraHasNoDepth) {
  CellConfig config = test::defaultSimCell();
  Plugged plugged(config);
  const auto opened = openCamera(config.cameras[0], plugged.cell.clock());
  EXPECT_THROW((void)opened.camera->next(Stream::kDepth, Instant{}), std::invalid_argument);
  config.cameras[0].infrared = InfraredConfig{};
  const std::string refusal = test::messageOf(
      ErrorKind::kHardwareAbsent, [&] { (void)openCamera(config.cameras[0], plugged.cell.clock()); });
  expectPart(refusal, "no such stream");
}

/// The color stream's settings as another user of the same device sees them.
bool exposureIsAutomatic() {
  openni::Device device;
  openni::VideoStream stream;
  EXPECT_EQ(device.open("servocal://front"), openni::STATUS_OK);
  EXPECT_EQ(stream.create(device, openni::SENSOR_COLOR), openni::STATUS_OK);
  const bool automatic = stream.getCameraSettings()->getAutoExposureEnabled();
  stream.destroy();
  return automatic;
}

TEST(OpenNi2, ExposureIsLockedOnRequestOnceItHasSettled) {
  const CellConfig config = kinect(DepthSensor::kTimeOfFlight);
  Plugged plugged(config);
  const auto left_alone = openCamera(config.cameras[0], plugged.cell.clock());
  EXPECT_TRUE(exposureIsAutomatic());
  OpenOptions options;
  options.lock_exposure = true;
  const Instant before = plugged.cell.clock().now();
  const auto locked = openCamera(config.cameras[0], plugged.cell.clock(), options);
  EXPECT_FALSE(exposureIsAutomatic());
  EXPECT_GE(plugged.cell.clock().now() - before, options.settle);
}

TEST(OpenNi2, SaysWhatTheDeviceCannotDoAndWhatIsNotProven) {
  const CellConfig config = kinect(DepthSensor::kTimeOfFlight);
  {
    Plugged plugged(config);
    const std::vector<std::string> notes = openCamera(config.cameras[0], plugged.cell.clock()).notes;
    ASSERT_EQ(notes.size(), 2u);
    expectPart(notes[0], "not exposed together");
    expectPart(notes[1], "not run on a real");
  }
  Served how;
  how.frame_sync = true;
  Plugged plugged(config, how);
  EXPECT_EQ(openCamera(config.cameras[0], plugged.cell.clock()).notes.size(), 1u);
}

}  // namespace
}  // namespace servocal::openni2
