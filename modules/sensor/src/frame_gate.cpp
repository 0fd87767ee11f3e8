// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor/frame_gate.h"

#include <algorithm>
#include <cstdio>
#include <cstring>

#include "servocal/core/error.h"

namespace servocal::sensor {
namespace {

constexpr int kRowsLookedAt = 120;  // Enough: noise changes every row of a living image.
constexpr int kFramesForRate = 30;
constexpr double kSlowShare = 0.5;  // Of the rate that was agreed on.

// FNV-1a (Fowler, Noll, Vo) over eight bytes at a time.
std::uint64_t contentOf(const cv::Mat& image) {
  constexpr std::uint64_t kPrime = 1099511628211u;
  std::uint64_t hash = 14695981039346656037u;
  const auto add = [&hash](std::uint64_t word) { hash = (hash ^ word) * kPrime; };
  add(static_cast<std::uint64_t>(image.type()));
  add(static_cast<std::uint64_t>(image.cols));
  const std::size_t bytes = static_cast<std::size_t>(image.cols) * image.elemSize();
  const int step = std::max(1, image.rows / kRowsLookedAt);
  for (int row = 0; row < image.rows; row += step) {
    const unsigned char* data = image.ptr(row);
    for (std::size_t at = 0; at < bytes; at += sizeof(std::uint64_t)) {
      std::uint64_t word = 0;
      std::memcpy(&word, data + at, std::min(sizeof word, bytes - at));
      add(word);
    }
  }
  return hash;
}

FrameFate drop(int& counter, FrameFate fate) {
  ++counter;
  return fate;
}

const Frame* nearestTo(Instant stamp, const std::vector<Frame>& frames) {
  const Frame* nearest = nullptr;
  for (const Frame& frame : frames) {
    if (!nearest || std::chrono::abs(frame.stamp - stamp) < std::chrono::abs(nearest->stamp - stamp))
      nearest = &frame;
  }
  return nearest;
}

}  // namespace

const char* toString(FrameFate fate) {
  switch (fate) {
    case FrameFate::kAccepted: return "accepted";
    case FrameFate::kOutOfDate: return "out_of_date";
    case FrameFate::kDuplicate: return "duplicate";
    case FrameFate::kReordered: return "reordered";
    case FrameFate::kFromFuture: return "from_future";
    case FrameFate::kFrozen: return "frozen";
  }
  return "unknown";
}

std::string FrameCounts::text() const {
  std::string list;
  const auto add = [&list](int count, const char* what) {
    if (count > 0) list += (list.empty() ? "" : ", ") + std::to_string(count) + " " + what;
  };
  add(out_of_date, "out of date");
  add(duplicate, "duplicate");
  add(reordered, "reordered");
  add(from_future, "from the future");
  add(frozen, "frozen");
  return list + (list.empty() ? "" : " of ") + std::to_string(accepted + dropped()) + " frames";
}

FrameFate FrameGate::judge(const Frame& frame, Instant now) {
  if (frame.stamp > now) return drop(counts_.from_future, FrameFate::kFromFuture);
  if (newest_ && frame.stamp == *newest_) return drop(counts_.duplicate, FrameFate::kDuplicate);
  if (newest_ && frame.stamp < *newest_) return drop(counts_.reordered, FrameFate::kReordered);
  newest_ = frame.stamp;
  const std::uint64_t content = contentOf(frame.image);
  const bool frozen = content_ == content;
  content_ = content;
  if (frozen) return drop(counts_.frozen, FrameFate::kFrozen);
  if (now - frame.stamp > options_.max_age) return drop(counts_.out_of_date, FrameFate::kOutOfDate);
  ++counts_.accepted;
  return FrameFate::kAccepted;
}

GatedCamera::Watch& GatedCamera::watch(Stream stream) {
  const auto found = watches_.find(stream);
  if (found != watches_.end()) return found->second;
  Watch fresh;
  fresh.gate = FrameGate(options_);
  if (stamps_) fresh.clock.emplace(*stamps_);
  return watches_.emplace(stream, std::move(fresh)).first->second;
}

const StreamMode* GatedCamera::mode(Stream stream) const {
  for (const StreamMode& mode : info().streams) {
    if (mode.stream == stream) return &mode;
  }
  return nullptr;
}

void GatedCamera::checkSize(const Frame& frame) const {
  const StreamMode* agreed = mode(frame.stream);
  if (!agreed || (frame.image.cols == agreed->width_px && frame.image.rows == agreed->height_px)) return;
  throw Error(
      ErrorKind::kHardwareAbsent,
      "Camera '" + info().name + "' sent a " + toString(frame.stream) + " image of " +
          std::to_string(frame.image.cols) + " x " + std::to_string(frame.image.rows) + " px in place of " +
          std::to_string(agreed->width_px) + " x " + std::to_string(agreed->height_px) +
          ". Another program changed its resolution, or the driver did: see that nothing else uses the "
          "camera, then resume the run.");
}

void GatedCamera::measureRate(Watch& by, const Frame& frame, Instant asked) const {
  const StreamMode* agreed = mode(frame.stream);
  if (!agreed || !(agreed->rate_hz > 0.0)) return;
  // Asked for before its successor can have come, the frame before was not followed by one that was missed.
  const bool missed_none = by.last_received && asked < *by.last_received + fromSeconds(0.5 / agreed->rate_hz);
  if (missed_none && frame.stamp > *by.last_stamp) {
    by.waited = std::min(by.waited + 1, kFramesForRate);
    by.gap_s += (toSeconds(frame.stamp - *by.last_stamp) - by.gap_s) / by.waited;
  }
  by.last_stamp = frame.stamp;
  by.last_received = frame.received;
}

std::optional<double> GatedCamera::measuredRateHz(Stream stream) const {
  const auto by = watches_.find(stream);
  if (by == watches_.end() || by->second.waited < kFramesForRate) return std::nullopt;
  return 1.0 / by->second.gap_s;
}

std::optional<std::string> GatedCamera::slowness(Stream stream) const {
  const auto measured = measuredRateHz(stream);
  if (!measured || *measured >= kSlowShare * mode(stream)->rate_hz) return std::nullopt;
  char text[200];
  std::snprintf(
      text, sizeof text,
      "%.1f images per second came in place of %.0f; see with servocal-devices whether it shares a USB "
      "controller, or whether it exposes longer for want of light",
      *measured, mode(stream)->rate_hz);
  return text;
}

std::optional<Frame> GatedCamera::next(Stream stream, Instant deadline) {
  Watch& by = watch(stream);
  Instant asked = clock_.now();
  while (std::optional<Frame> frame = camera_.next(stream, deadline)) {
    checkSize(*frame);
    if (by.clock) frame->stamp = by.clock->read(frame->device_stamp_s, frame->received).stamp;
    frame->stamp -= fromSeconds(by.offset_s);
    measureRate(by, *frame, asked);
    asked = clock_.now();
    if (by.gate.judge(*frame, clock_.now()) == FrameFate::kAccepted) return frame;
  }
  return std::nullopt;
}

void GatedCamera::setOffset(Stream stream, double offset_s) {
  Watch& by = watch(stream);
  by.offset_s = offset_s;
  by.gate.restamped();
  by.last_stamp.reset();
  by.last_received.reset();
}

FrameCounts GatedCamera::counts(Stream stream) const {
  const auto found = watches_.find(stream);
  return found == watches_.end() ? FrameCounts{} : found->second.gate.counts();
}

std::optional<std::vector<Frame>> pairFrames(const std::vector<std::vector<Frame>>& streams,
                                             Duration tolerance) {
  if (streams.empty()) return std::nullopt;
  std::optional<std::vector<Frame>> newest;
  for (const Frame& frame : streams.front()) {
    std::vector<Frame> set{frame};
    Instant first = frame.stamp, last = frame.stamp;
    for (std::size_t other = 1; other < streams.size(); ++other) {
      const Frame* nearest = nearestTo(frame.stamp, streams[other]);
      if (!nearest) return std::nullopt;
      set.push_back(*nearest);
      first = std::min(first, nearest->stamp);
      last = std::max(last, nearest->stamp);
    }
    if (last - first > tolerance || (newest && newest->front().stamp >= frame.stamp)) continue;
    newest = std::move(set);
  }
  return newest;
}

}  // namespace servocal::sensor
