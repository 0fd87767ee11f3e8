// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "capture_camera.h"
#include "errors.h"
#include "fake_capture.h"

namespace servocal::v4l2 {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::FakeCapture;
using test::Webcam;

class V4l2Camera : public testing::Test {
 protected:
  V4l2Camera() {
    config.name = "web";
    config.backend = CameraBackend::kV4l2;
    config.width_px = 640;
    config.height_px = 480;
    config.latency_s = 0.02;
  }
  OpenedCamera open(const OpenOptions& options = {}) {
    return openFrom(config, clock, options,
                    {[this] {
                       if (!there) throw Error(ErrorKind::kHardwareAbsent, "Camera 'web' is not there.");
                       return Node{"/dev/v4l/by-id/usb-Maker_Cam_77-video-index0", "usb-Maker_Cam_77"};
                     },
                     [this](const Node&) -> std::unique_ptr<cv::VideoCapture> {
                       if (busy) return nullptr;
                       return std::make_unique<FakeCapture>(webcam);
                     }});
  }
  sensor::Frame frame(sensor::RgbdCamera& camera) {
    auto next = camera.next(Stream::kColor, clock.now() + seconds(10));
    EXPECT_TRUE(next);
    return next ? *next : sensor::Frame{};
  }
  static bool hasNote(const OpenedCamera& opened, const std::string& part) {
    for (const std::string& note : opened.notes) {
      if (note.find(part) != std::string::npos) return true;
    }
    return false;
  }

  CameraConfig config;
  WallClock clock;
  Webcam webcam;
  bool there = true, busy = false;
};

TEST_F(V4l2Camera, HandsOutColorOfTheSizeAskedForWithRisingStampsAndNumbers) {
  const OpenedCamera opened = open();
  EXPECT_EQ(opened.camera->info().serial, "usb-Maker_Cam_77");
  EXPECT_DOUBLE_EQ(opened.camera->info().streams.at(0).rate_hz, 30.0);
  const sensor::Frame first = frame(*opened.camera), second = frame(*opened.camera);
  EXPECT_EQ(first.image.type(), CV_8UC3);
  EXPECT_EQ(first.image.size(), cv::Size(640, 480));
  EXPECT_GT(second.stamp, first.stamp);
  EXPECT_GT(second.sequence, first.sequence);
  EXPECT_GT(second.device_stamp_s, first.device_stamp_s);
  // The kernel's stamp is the exposure; the frame came `latency_s` after it at the least.
  EXPECT_NEAR(toSeconds(first.received - first.stamp), config.latency_s, 0.015);
  EXPECT_TRUE(hasNote(opened, "not run on a real UVC camera"));
  EXPECT_FALSE(hasNote(opened, "motion JPEG"));
}

TEST_F(V4l2Camera, WithoutStampsOfTheDriverTheArrivalCounts) {
  webcam.tells_stamps = false;
  const OpenedCamera opened = open();
  const sensor::Frame one = frame(*opened.camera);
  EXPECT_DOUBLE_EQ(one.device_stamp_s, toSeconds(one.received));
}

// A slow reader gets what is new, not what waited; and pays for the decoding of that alone.
TEST_F(V4l2Camera, NothingIsDecodedThatNobodyAsksFor) {
  const OpenedCamera opened = open();
  const sensor::Frame before = frame(*opened.camera);
  clock.sleepFor(milliseconds(1000));
  const Instant asked = clock.now();
  const sensor::Frame after = frame(*opened.camera);
  EXPECT_GT(after.received, asked - milliseconds(20));
  const auto came = after.sequence - before.sequence;
  const std::lock_guard<std::mutex> lock(webcam.mutex);
  EXPECT_GT(came, 40u);
  EXPECT_LT(webcam.decoded, static_cast<int>(came) / 2);
}

TEST_F(V4l2Camera, TakesMotionJpegOnlyWhereRawImagesAreSlow) {
  config.width_px = 1280;
  config.height_px = 720;
  const OpenedCamera opened = open();
  EXPECT_TRUE(hasNote(opened, "motion JPEG"));
  EXPECT_EQ(frame(*opened.camera).image.size(), cv::Size(1280, 720));
}

TEST_F(V4l2Camera, ASizeThatIsNotOfferedIsRefusedAndNamesOneThatIs) {
  config.width_px = 1920;
  config.height_px = 1080;
  const std::string message = test::messageOf(ErrorKind::kHardwareAbsent, [&] { open(); });
  test::expectPart(message, "1920 x 1080");
  test::expectPart(message, "640 x 480");
}

TEST_F(V4l2Camera, AnImageOfAnotherSizeIsAnError) {
  const OpenedCamera opened = open();
  webcam.sends = {320, 240};
  test::expectPart(test::messageOf(ErrorKind::kHardwareAbsent,
                                   [&] {
                                     for (int i = 0; i < 5; ++i) frame(*opened.camera);
                                   }),
                   "320 x 240");
}

TEST_F(V4l2Camera, AutofocusIsSwitchedOffAndACameraWithoutIsNotBlamed) {
  (void)open();
  EXPECT_EQ(webcam.property(cv::CAP_PROP_AUTOFOCUS), 0.0);
  webcam.has_autofocus = false;
  EXPECT_FALSE(hasNote(open(), "autofocus"));
}

TEST_F(V4l2Camera, ExposureIsLeftAloneUnlessAskedFor) {
  (void)open();
  EXPECT_EQ(webcam.property(cv::CAP_PROP_AUTO_EXPOSURE), 3.0);
  OpenOptions lock;
  lock.lock_exposure = true;
  lock.settle = milliseconds(50);
  const OpenedCamera opened = open(lock);
  EXPECT_EQ(webcam.property(cv::CAP_PROP_AUTO_EXPOSURE), 1.0);
  EXPECT_EQ(webcam.property(cv::CAP_PROP_EXPOSURE), 157.0);
  EXPECT_EQ(webcam.property(cv::CAP_PROP_AUTO_WB), 0.0);
  EXPECT_FALSE(hasNote(opened, "not locked"));
  webcam.locks_exposure = false;
  EXPECT_TRUE(hasNote(open(lock), "exposure is not locked"));
}

TEST_F(V4l2Camera, AnUnpluggedCameraIsMissedAndKnownAgain) {
  const OpenedCamera opened = open();
  const sensor::Frame before = frame(*opened.camera);
  there = false;
  {
    const std::lock_guard<std::mutex> lock(webcam.mutex);
    webcam.plugged = false;
  }
  for (int i = 0; i < 2; ++i) {
    test::messageOf(ErrorKind::kHardwareAbsent, [&] {
      for (int j = 0; j < 50; ++j) (void)opened.camera->next(Stream::kColor, clock.now() + milliseconds(100));
    });
  }
  webcam.plugged = there = true;
  const sensor::Frame after = frame(*opened.camera);
  EXPECT_GT(after.sequence, before.sequence);
  EXPECT_GT(after.stamp, before.stamp);
}

TEST_F(V4l2Camera, OneThatDoesNotOpenSaysSo) {
  busy = true;
  test::expectPart(test::messageOf(ErrorKind::kHardwareAbsent, [&] { open(); }), "another program");
}

TEST_F(V4l2Camera, HasNeitherInfraredNorDepth) {
  const OpenedCamera opened = open();
  EXPECT_THROW((void)opened.camera->next(Stream::kDepth, clock.now()), std::invalid_argument);
  config.infrared = InfraredConfig{};
  test::messageOf(ErrorKind::kInvalidConfig, [&] { open(); });
}

}  // namespace
}  // namespace servocal::v4l2
