// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <opencv2/imgproc.hpp>

#include "errors.h"
#include "servocal/sensor/frame_gate.h"

namespace servocal::sensor {
namespace {

Instant at(double seconds) { return Instant(fromSeconds(seconds)); }

Frame frameAt(double seconds, int content, Stream stream = Stream::kColor) {
  Frame frame;
  frame.stream = stream;
  frame.stamp = at(seconds);
  frame.image = cv::Mat(48, 65, CV_8UC1, cv::Scalar(90));
  frame.image.at<unsigned char>(40, 64) = static_cast<unsigned char>(content);
  return frame;
}

// Hands out what it was given.
class ListCamera final : public RgbdCamera {
 public:
  const CameraInfo& info() const override { return info_; }
  std::optional<Frame> next(Stream, Instant) override {
    if (frames.empty()) return std::nullopt;
    const Frame frame = frames.front();
    frames.pop_front();
    return frame;
  }
  std::deque<Frame> frames;
  CameraInfo info_;
};

// Delivers a frame every `period_s`, of `size`, on a clock that it moves on itself.
class SteadyCamera final : public RgbdCamera {
 public:
  explicit SteadyCamera(Clock& clock) : clock_(clock) {
    info_.name = "side";
    info_.streams = {{Stream::kColor, 65, 48, 30.0, false}};
  }
  const CameraInfo& info() const override { return info_; }
  std::optional<Frame> next(Stream stream, Instant) override {
    const auto period = fromSeconds(period_s);
    const auto missed = std::max<std::int64_t>(0, (clock_.now() - delivered_) / period - 1);
    delivered_ += (missed + 1) * period;
    clock_.sleepUntil(delivered_);
    Frame frame = frameAt(0.0, 1 + static_cast<int>(++count_ % 200), stream);
    cv::resize(frame.image, frame.image, size, 0, 0, cv::INTER_NEAREST);
    frame.stamp = delivered_ - std::chrono::milliseconds(20);
    frame.received = delivered_;
    return frame;
  }
  double period_s = 1.0 / 30.0;
  cv::Size size{65, 48};

 private:
  Clock& clock_;
  CameraInfo info_;
  Instant delivered_ = at(1.0);
  std::int64_t count_ = 0;
};

TEST(FrameGate, NamesEachFate) {
  FrameGate gate;
  EXPECT_EQ(gate.judge(frameAt(1.00, 1), at(1.05)), FrameFate::kAccepted);
  EXPECT_EQ(gate.judge(frameAt(1.00, 2), at(1.06)), FrameFate::kDuplicate);
  EXPECT_EQ(gate.judge(frameAt(0.97, 3), at(1.07)), FrameFate::kReordered);
  EXPECT_EQ(gate.judge(frameAt(1.20, 4), at(1.10)), FrameFate::kFromFuture);
  EXPECT_EQ(gate.judge(frameAt(1.03, 1), at(1.10)), FrameFate::kFrozen);
  EXPECT_EQ(gate.judge(frameAt(1.07, 1), at(1.13)), FrameFate::kFrozen);
  EXPECT_EQ(gate.judge(frameAt(1.10, 5), at(1.70)), FrameFate::kOutOfDate);
  EXPECT_EQ(gate.judge(frameAt(1.30, 6), at(1.71)), FrameFate::kAccepted);
  EXPECT_EQ(gate.counts().accepted, 2);
  EXPECT_EQ(gate.counts().text(),
            "1 out of date, 1 duplicate, 1 reordered, 1 from the future, 2 frozen of 8 frames");
  EXPECT_EQ(FrameGate().counts().text(), "0 frames");
}

TEST(GatedCamera, HandsOutOnlyGoodFramesAndCountsPerStream) {
  SimulatedClock clock;
  clock.sleepUntil(at(2.0));
  ListCamera list;
  list.frames = {frameAt(1.80, 1), frameAt(1.80, 1), frameAt(1.70, 2), frameAt(1.85, 1), frameAt(1.90, 3)};
  GatedCamera camera(list, clock);
  EXPECT_EQ(camera.next(Stream::kColor, at(2.1))->stamp, at(1.80));
  EXPECT_EQ(camera.next(Stream::kColor, at(2.1))->stamp, at(1.90));
  EXPECT_FALSE(camera.next(Stream::kColor, at(2.1)).has_value());
  EXPECT_EQ(camera.counts(Stream::kColor).dropped(), 3);
  EXPECT_EQ(camera.counts(Stream::kColor).frozen, 1);
  EXPECT_EQ(camera.counts(Stream::kDepth).dropped(), 0);
  // Another stream has its own order.
  list.frames = {frameAt(1.75, 1, Stream::kDepth)};
  EXPECT_TRUE(camera.next(Stream::kDepth, at(2.1)).has_value());
}

TEST(GatedCamera, RefusesAnImageOfAnotherSizeThanWasAgreedOn) {
  SimulatedClock clock;
  SteadyCamera steady(clock);
  GatedCamera camera(steady, clock);
  EXPECT_TRUE(camera.next(Stream::kColor, at(9.0)));
  steady.size = {32, 24};
  const std::string message =
      test::messageOf(ErrorKind::kHardwareAbsent, [&] { (void)camera.next(Stream::kColor, at(9.0)); });
  test::expectPart(message, "'side'");
  test::expectPart(message, "32 x 24 px in place of 65 x 48");
}

TEST(GatedCamera, SaysWhenFramesComeTooSlowly) {
  SimulatedClock clock;
  SteadyCamera steady(clock);
  GatedCamera camera(steady, clock);
  const auto look = [&](int frames) {
    for (int i = 0; i < frames; ++i) (void)camera.next(Stream::kColor, at(1e3));
  };
  look(20);
  EXPECT_FALSE(camera.measuredRateHz(Stream::kColor));
  look(20);
  EXPECT_NEAR(camera.measuredRateHz(Stream::kColor).value(), 30.0, 0.1);
  EXPECT_FALSE(camera.slowness(Stream::kColor));
  steady.period_s = 0.25;
  look(100);
  EXPECT_NEAR(camera.measuredRateHz(Stream::kColor).value(), 4.0, 0.2);
  test::expectPart(camera.slowness(Stream::kColor).value(), "4.1 images per second came in place of 30");
}

// Whoever comes late to fetch frames learns nothing of the camera.
TEST(GatedCamera, DoesNotBlameTheCameraForASlowProgram) {
  SimulatedClock clock;
  SteadyCamera steady(clock);
  GatedCamera camera(steady, clock);
  for (int i = 0; i < 200; ++i) {
    (void)camera.next(Stream::kColor, at(1e3));
    clock.sleepFor(std::chrono::milliseconds(150));
  }
  EXPECT_FALSE(camera.measuredRateHz(Stream::kColor));
  EXPECT_FALSE(camera.slowness(Stream::kColor));
}

TEST(PairFrames, FindsTheNewestMomentThatAllStreamsSaw) {
  const std::vector<Frame> color{frameAt(1.000, 1), frameAt(1.033, 2), frameAt(1.066, 3)};
  const std::vector<Frame> depth{frameAt(0.995, 1, Stream::kDepth), frameAt(1.030, 2, Stream::kDepth)};
  const auto pair = pairFrames({color, depth}, std::chrono::milliseconds(10));
  ASSERT_TRUE(pair);
  EXPECT_EQ((*pair)[0].stamp, at(1.033));
  EXPECT_EQ((*pair)[1].stamp, at(1.030));
  // One before and one after: each near the color frame, but not near each other.
  const std::vector<Frame> infrared{frameAt(1.041, 1, Stream::kInfrared)};
  EXPECT_FALSE(pairFrames({color, depth, infrared}, std::chrono::milliseconds(10)));
  EXPECT_TRUE(pairFrames({color, depth, infrared}, std::chrono::milliseconds(12)));
  EXPECT_FALSE(pairFrames({color, {}}, std::chrono::milliseconds(10)));
  EXPECT_FALSE(pairFrames({}, std::chrono::milliseconds(10)));
}

}  // namespace
}  // namespace servocal::sensor
