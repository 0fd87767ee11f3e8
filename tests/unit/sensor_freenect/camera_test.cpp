// SPDX-License-Identifier: GPL-3.0-or-later
// Our backend on libfreenect's own replay of a recording that is made of simulated pictures.
#include "servocal/sensor_freenect/camera.h"

#include <gtest/gtest.h>
#include <stdlib.h>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "default_sim.h"
#include "errors.h"
#include "fakenect_more.h"
#include "recording.h"
#include "servocal/board/detector.h"
#include "servocal/sim/cell.h"

namespace servocal::freenect {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::expectPart;
using test::fakeKinects;

constexpr double kWrapS = 4294967296.0 / 60e6;
constexpr double kBeforeTheTurnS = 6.0;  // Time for the tests before, and for a busy computer.

/// What a simulated Kinect v1 sees, and a recording of it: blue and green are the color camera's picture, red
/// the infrared camera's.
struct Recorded {
  Recorded() : config(test::kinectSimCell(DepthSensor::kStructuredLight)) {
    sim::Cell cell(config, 3);
    const auto see = [&](Stream stream) {
      return cell.camera("front").next(stream, cell.clock().now() + seconds(3)).value().image;
    };
    color = see(Stream::kColor);
    infrared = see(Stream::kInfrared);
    depth = see(Stream::kDepth);
    cv::Mat rgb;
    cv::merge(std::vector<cv::Mat>{infrared, color, color}, rgb);
    recording.emplace(rgb, depth, 60.0, static_cast<std::uint32_t>(60e6 * (kWrapS - kBeforeTheTurnS)));
    ::setenv("FAKENECT_PATH", recording->path().c_str(), 1);
  }
  CellConfig config;
  cv::Mat color, infrared, depth;
  std::optional<test::KinectRecording> recording;
};

/// fakenect plays one recording in the life of a program.
const Recorded& recorded() {
  static const Recorded instance;
  return instance;
}

class Freenect : public testing::Test {
 protected:
  Freenect() {
    config = recorded().config.cameras[0];
    config.backend = CameraBackend::kFreenect;
    config.latency_s = 0.04;
    auto& kinects = fakeKinects();
    const std::lock_guard<std::mutex> lock(kinects.mutex);
    kinects.serials = {"A00362A01385118A"};
    kinects.busy = kinects.cable_cut = false;
    kinects.obeys_flags = true;
    kinects.violations.clear();
  }
  ~Freenect() override {
    const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
    for (const std::string& violation : fakeKinects().violations) ADD_FAILURE() << violation;
  }

  sensor::Frame frame(const OpenedCamera& opened, Stream stream) {
    auto next = opened.camera->next(stream, clock.now() + seconds(10));
    EXPECT_TRUE(next) << toString(stream);
    return next ? *next : sensor::Frame{};
  }
  std::string refusal(ErrorKind kind = ErrorKind::kHardwareAbsent) {
    return test::messageOf(kind, [&] { (void)openCamera(config, clock); });
  }
  static std::vector<freenect_flag> switchedOff() {
    const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
    return fakeKinects().off;
  }

  CameraConfig config;
  WallClock clock;
};

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0.0;
}

cv::Mat channel(const cv::Mat& image, int which) {
  cv::Mat one;
  cv::extractChannel(image, one, which);
  return one;
}

TEST_F(Freenect, EveryStreamIsTheRecordedOneBitByBit) {
  OpenOptions raw;
  raw.raw_infrared = true;
  const OpenedCamera opened = openCamera(config, clock, raw);
  EXPECT_EQ(opened.camera->info().serial, "A00362A01385118A");
  ASSERT_EQ(opened.camera->info().streams.size(), 3u);
  const cv::Mat color = frame(opened, Stream::kColor).image;
  ASSERT_EQ(color.type(), CV_8UC3);
  EXPECT_TRUE(same(channel(color, 0), recorded().color));
  EXPECT_TRUE(same(channel(color, 2), recorded().infrared)) << "not blue, green, red";
  cv::Mat counts;
  recorded().infrared.convertTo(counts, CV_16U, 4.0);
  EXPECT_TRUE(same(frame(opened, Stream::kInfrared).image, counts)) << "the middle 480 of 488 rows";
  EXPECT_TRUE(same(frame(opened, Stream::kDepth).image, recorded().depth));
}

TEST_F(Freenect, TheBoardIsFoundInColorAndInInfrared) {
  const OpenedCamera opened = openCamera(config, clock);
  board::Detector detector(recorded().config.board);
  for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
    cv::Mat image = frame(opened, stream).image;
    if (stream == Stream::kColor) image = channel(image, 0);
    ASSERT_EQ(image.type(), CV_8UC1);
    const auto found = detector.detect(image);
    const auto expected = detector.detect(stream == Stream::kColor ? recorded().color : recorded().infrared);
    ASSERT_TRUE(found && expected) << toString(stream);
    ASSERT_EQ(found->corners.size(), expected->corners.size());
    for (std::size_t i = 0; i < found->corners.size(); ++i)
      EXPECT_LT((found->corners[i].pixel - expected->corners[i].pixel).norm(), 0.1);  // The gain rounds.
  }
}

TEST_F(Freenect, StampsAndNumbersRiseAcrossTheTurnOfTheDevicesCounter) {
  const OpenedCamera opened = openCamera(config, clock);
  sensor::Frame last = frame(opened, Stream::kColor);
  const double first_s = last.device_stamp_s;
  while (last.device_stamp_s < kWrapS + 1.0 && !HasFailure()) {
    const sensor::Frame next = frame(opened, Stream::kColor);
    const double periods = 30.0 * (next.device_stamp_s - last.device_stamp_s);
    EXPECT_NEAR(periods, std::round(periods), 0.01);
    EXPECT_GT(periods, 0.5);
    EXPECT_LT(periods, 60.0);  // A busy computer skips some, but the counter's turn is not time.
    EXPECT_GT(next.sequence, last.sequence);
    EXPECT_GE(next.received - next.stamp, milliseconds(39));
    last = next;
  }
  EXPECT_LT(first_s, kWrapS);
  EXPECT_GT(last.device_stamp_s, kWrapS);
}

TEST_F(Freenect, ColorAndInfraredTakeTurns) {
  const OpenedCamera opened = openCamera(config, clock);
  for (int turn = 0; turn < 2; ++turn) {
    for (const Stream stream : {Stream::kColor, Stream::kInfrared, Stream::kDepth}) {
      const Instant asked = clock.now();
      const sensor::Frame got = frame(opened, stream);
      // Nothing that was exposed before the change; depth runs beside infrared.
      if (stream != Stream::kDepth) {
        EXPECT_GE(got.stamp + milliseconds(5), asked) << toString(stream);
      }
    }
  }
}

TEST_F(Freenect, AnUnpluggedKinectIsNamedAndKnownAgainBySerial) {
  const OpenedCamera opened = openCamera(config, clock);
  const sensor::Frame before = frame(opened, Stream::kDepth);
  {
    const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
    fakeKinects().cable_cut = true;
    fakeKinects().serials = {"B00361701006050B"};  // Another one is no replacement.
  }
  for (int again = 0; again < 2; ++again) {
    const std::string gone = test::messageOf(ErrorKind::kHardwareAbsent, [&] {
      for (int i = 0; i < 50; ++i) (void)opened.camera->next(Stream::kDepth, clock.now() + milliseconds(100));
    });
    expectPart(gone, "'front' (Kinect v1 A00362A01385118A) is gone");
    expectPart(gone, "serial number");
  }
  {
    const std::lock_guard<std::mutex> lock(fakeKinects().mutex);
    fakeKinects().serials.push_back("A00362A01385118A");
  }
  const sensor::Frame after = frame(opened, Stream::kDepth);
  EXPECT_GT(after.sequence, before.sequence);
  EXPECT_GT(after.stamp, before.stamp);
  EXPECT_TRUE(same(after.image, recorded().depth));
}

TEST_F(Freenect, OneOfSeveralMustBeNamed) {
  fakeKinects().serials = {"A00362A01385118A", "B00361701006050B"};
  expectPart(refusal(), "A00362A01385118A (number 0), B00361701006050B (number 1)");
  config.device = "A00000000000000A";
  expectPart(refusal(), "no Kinect v1 'A00000000000000A'");
  expectPart(refusal(), "B00361701006050B");
  config.device = "7";
  expectPart(refusal(), "no Kinect v1 '7'");
  for (const char* device : {"1", "B00361701006050B"}) {
    config.device = device;
    EXPECT_EQ(openCamera(config, clock).camera->info().serial, "B00361701006050B");
  }
  fakeKinects().serials = {};
  expectPart(refusal(), "no Kinect v1 is plugged in");
}

TEST_F(Freenect, AKinectThatAnotherProgramHasIsNamed) {
  fakeKinects().busy = true;
  expectPart(refusal(), "(Kinect v1 A00362A01385118A) does not open");
  expectPart(refusal(), "Another program may have it");
}

TEST_F(Freenect, WhatNoKinectHasIsRefusedBeforeOneIsLookedFor) {
  fakeKinects().serials = {};
  CameraConfig& camera = config;
  camera.width_px = 1920;
  camera.height_px = 1080;
  expectPart(refusal(ErrorKind::kInvalidConfig), "640 x 480 or 1280 x 1024");
  camera.width_px = 640;
  camera.height_px = 480;
  camera.infrared->width_px = 512;
  expectPart(refusal(ErrorKind::kInvalidConfig), "'infrared'");
  camera.infrared->width_px = 640;
  camera.infrared->excludes_color = false;
  expectPart(refusal(ErrorKind::kInvalidConfig), "excludes_color: true");
}

// The sensor forgets its settings when it changes its mode, so they are set again.
TEST_F(Freenect, ExposureIsLockedOnRequestAndStaysSoWhenColorComesBack) {
  OpenOptions lock;
  lock.lock_exposure = true;
  lock.settle = milliseconds(100);
  const std::vector<freenect_flag> both{FREENECT_AUTO_EXPOSURE, FREENECT_AUTO_WHITE_BALANCE};
  {
    const OpenedCamera opened = openCamera(config, clock, lock);
    EXPECT_EQ(switchedOff(), both);
    (void)frame(opened, Stream::kInfrared);
    EXPECT_TRUE(switchedOff().empty());
    (void)frame(opened, Stream::kColor);
    EXPECT_EQ(switchedOff(), both);
    EXPECT_EQ(opened.notes.size(), 1u);
  }
  fakeKinects().obeys_flags = false;
  expectPart(openCamera(config, clock, lock).notes[0], "not locked");
  fakeKinects().obeys_flags = true;
  const OpenedCamera opened = openCamera(config, clock);
  (void)frame(opened, Stream::kColor);
  EXPECT_TRUE(switchedOff().empty());
}

TEST_F(Freenect, SaysWhatIsNotProven) {
  const OpenedCamera opened = openCamera(config, clock);
  ASSERT_EQ(opened.notes.size(), 1u);
  expectPart(opened.notes[0], "not run on a real Kinect v1");
}

}  // namespace
}  // namespace servocal::freenect
