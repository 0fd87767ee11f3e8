// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <opencv2/videoio.hpp>
#include <optional>
#include <thread>

#include "servocal/core/clock.h"

namespace servocal::v4l2 {

/// What came off the driver's queue.
struct RawFrame {
  cv::Mat image;  ///< BGR
  Instant received{};
  double driver_stamp_s = 0.0;  ///< 0: the driver gives none.
  std::uint64_t number = 0;     ///< Of the frames read so far, decoded or not.
};

/// Takes every frame off a capture's queue, in a thread of its own, and decodes those that
/// somebody may want.
class Reader {
 public:
  Reader(std::unique_ptr<cv::VideoCapture> capture, const Clock& clock);
  ~Reader();
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  /// The newest frame that was not handed out before; nothing if it is not there yet, or not decoded because
  /// nobody had asked for a while.
  std::optional<RawFrame> take();
  /// False once the device stopped delivering.
  bool alive() const { return alive_; }
  /// Does something with the capture between two frames, and waits until it is done; nothing if the device
  /// died.
  void between(const std::function<void(cv::VideoCapture&)>& action);

 private:
  void run();
  bool takeOne(std::uint64_t number);

  std::unique_ptr<cv::VideoCapture> capture_;  ///< The thread's own.
  const Clock& clock_;
  std::mutex mutex_;              ///< Guards the four below.
  std::optional<Instant> asked_;  ///< When take() was called last.
  std::optional<RawFrame> newest_;
  std::uint64_t latest_ = 0;  ///< Number of the frame that came last, decoded or not.
  std::optional<std::packaged_task<void(cv::VideoCapture&)>> action_;
  std::atomic<bool> alive_{true};
  std::atomic<bool> quit_{false};
  std::thread thread_;
};

}  // namespace servocal::v4l2
