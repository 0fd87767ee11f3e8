// SPDX-License-Identifier: GPL-3.0-or-later
// A webcam in the place of OpenCV's capture of one.
#pragma once

#include <chrono>
#include <map>
#include <mutex>
#include <opencv2/videoio.hpp>
#include <thread>
#include <utility>

namespace servocal::test {

/// What is on the other end of the cable; shared with the test.
struct Webcam {
  using Size = std::pair<int, int>;
  std::map<int, std::map<Size, double>> rates;  ///< By fourcc and size, Hz.
  bool has_autofocus = true;
  bool locks_exposure = true;
  bool tells_stamps = true;
  double focus_steps = 0.0;

  std::mutex mutex;  ///< Guards everything below.
  bool plugged = true;
  std::map<int, double> properties;
  int decoded = 0;
  Size sends{0, 0};  ///< Instead of what was set.

  Webcam() {
    rates[cv::VideoWriter::fourcc('Y', 'U', 'Y', 'V')] = {{{640, 480}, 30.0}, {{1280, 720}, 10.0}};
    rates[cv::VideoWriter::fourcc('M', 'J', 'P', 'G')] = {{{640, 480}, 30.0}, {{1280, 720}, 30.0}};
    properties = {{cv::CAP_PROP_AUTOFOCUS, 1.0},         {cv::CAP_PROP_AUTO_EXPOSURE, 3.0},
                  {cv::CAP_PROP_EXPOSURE, 157.0},        {cv::CAP_PROP_AUTO_WB, 1.0},
                  {cv::CAP_PROP_WB_TEMPERATURE, 4600.0}, {cv::CAP_PROP_FRAME_WIDTH, 640.0},
                  {cv::CAP_PROP_FRAME_HEIGHT, 480.0}};
  }
  double property(int id) {
    const std::lock_guard<std::mutex> lock(mutex);
    return properties[id];
  }
};

class FakeCapture final : public cv::VideoCapture {
 public:
  explicit FakeCapture(Webcam& webcam) : webcam_(webcam) {}

  bool isOpened() const override { return true; }
  bool grab() override {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const std::lock_guard<std::mutex> lock(webcam_.mutex);
    stamp_ms_ = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch())
                    .count();
    ++number_;
    return webcam_.plugged;
  }
  bool retrieve(cv::OutputArray image, int) override {
    const std::lock_guard<std::mutex> lock(webcam_.mutex);
    ++webcam_.decoded;
    const auto [width, height] = webcam_.sends.first > 0 ? webcam_.sends : size();
    cv::Mat(height, width, CV_8UC3, cv::Scalar(number_ % 256, 10, 20)).copyTo(image);
    return true;
  }
  bool set(int id, double value) override {
    const std::lock_guard<std::mutex> lock(webcam_.mutex);
    if (id == cv::CAP_PROP_AUTOFOCUS && !webcam_.has_autofocus) return false;
    if ((id == cv::CAP_PROP_AUTO_EXPOSURE || id == cv::CAP_PROP_AUTO_WB) && !webcam_.locks_exposure)
      return false;
    webcam_.properties[id] = value;
    // As V4L2 does: what is not offered becomes something that is.
    auto& offered = webcam_.rates[static_cast<int>(webcam_.properties[cv::CAP_PROP_FOURCC])];
    if (id == cv::CAP_PROP_FRAME_HEIGHT && offered.count(size()) == 0 && !offered.empty()) {
      webcam_.properties[cv::CAP_PROP_FRAME_WIDTH] = offered.begin()->first.first;
      webcam_.properties[cv::CAP_PROP_FRAME_HEIGHT] = offered.begin()->first.second;
    }
    return true;
  }
  double get(int id) const override {
    const std::lock_guard<std::mutex> lock(webcam_.mutex);
    if (id == cv::CAP_PROP_POS_MSEC) return webcam_.tells_stamps ? stamp_ms_ : 0.0;
    if (id == cv::CAP_PROP_FPS)
      return webcam_.rates[static_cast<int>(webcam_.properties[cv::CAP_PROP_FOURCC])][size()];
    if (id == cv::CAP_PROP_AUTOFOCUS && !webcam_.has_autofocus) return -1.0;
    return webcam_.properties[id];
  }

 private:
  Webcam::Size size() const {
    return {static_cast<int>(webcam_.properties[cv::CAP_PROP_FRAME_WIDTH]),
            static_cast<int>(webcam_.properties[cv::CAP_PROP_FRAME_HEIGHT])};
  }

  Webcam& webcam_;
  double stamp_ms_ = 0.0;
  int number_ = 0;
};

}  // namespace servocal::test
