// SPDX-License-Identifier: GPL-3.0-or-later
#include "reader.h"

#include <utility>

namespace servocal::v4l2 {
namespace {

// Who asks in a loop asks oftener than that.
constexpr Duration kAskHolds = std::chrono::milliseconds(100);

}  // namespace

Reader::Reader(std::unique_ptr<cv::VideoCapture> capture, const Clock& clock)
    : capture_(std::move(capture)), clock_(clock), thread_([this] { run(); }) {}

Reader::~Reader() {
  quit_ = true;
  thread_.join();
}

std::optional<RawFrame> Reader::take() {
  const std::lock_guard<std::mutex> lock(mutex_);
  asked_ = clock_.now();
  std::optional<RawFrame> frame = std::exchange(newest_, std::nullopt);
  if (frame && frame->number != latest_) frame.reset();  // A newer one has come meanwhile.
  return frame;
}

void Reader::between(const std::function<void(cv::VideoCapture&)>& action) {
  std::future<void> done;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!alive_) return;
    done = action_.emplace(action).get_future();
  }
  done.wait();
}

bool Reader::takeOne(std::uint64_t number) {
  if (!capture_->grab()) return false;
  RawFrame frame;
  frame.number = number;
  frame.received = clock_.now();
  frame.driver_stamp_s = 1e-3 * capture_->get(cv::CAP_PROP_POS_MSEC);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    latest_ = number;
    if (!asked_ || frame.received - *asked_ > kAskHolds) return true;
  }
  if (!capture_->retrieve(frame.image) || frame.image.empty()) return true;  // A torn frame; the next may do.
  frame.image = frame.image.clone();  // It may lie in the capture's own buffer.
  const std::lock_guard<std::mutex> lock(mutex_);
  newest_ = std::move(frame);
  return true;
}

void Reader::run() {
  for (std::uint64_t number = 0; !quit_ && takeOne(number); ++number) {
    std::optional<std::packaged_task<void(cv::VideoCapture&)>> action;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      action = std::exchange(action_, std::nullopt);
    }
    if (action) (*action)(*capture_);
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  alive_ = false;
  action_.reset();  // Whoever waits for it goes on.
}

}  // namespace servocal::v4l2
