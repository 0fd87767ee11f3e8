// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor/frame_gate.h"

#include <algorithm>
#include <cstring>

namespace servocal::sensor {
namespace {

constexpr int kRowsLookedAt = 120;  // Enough: noise changes every row of a living image.

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
  Watch fresh{FrameGate(options_), std::nullopt};
  if (stamps_) fresh.clock.emplace(*stamps_);
  return watches_.emplace(stream, std::move(fresh)).first->second;
}

std::optional<Frame> GatedCamera::next(Stream stream, Instant deadline) {
  Watch& by = watch(stream);
  while (std::optional<Frame> frame = camera_.next(stream, deadline)) {
    if (by.clock) frame->stamp = by.clock->read(frame->device_stamp_s, frame->received).stamp;
    frame->stamp -= fromSeconds(by.offset_s);
    if (by.gate.judge(*frame, clock_.now()) == FrameFate::kAccepted) return frame;
  }
  return std::nullopt;
}

void GatedCamera::setOffset(Stream stream, double offset_s) {
  Watch& by = watch(stream);
  by.offset_s = offset_s;
  by.gate.restamped();
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
