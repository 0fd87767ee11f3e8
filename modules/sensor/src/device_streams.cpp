// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor/device_streams.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace servocal::sensor {
namespace {

constexpr std::chrono::milliseconds kPoll{1};

}  // namespace

DeviceStreams::DeviceStreams(std::string camera, Clock& clock, bool exclusive,
                             const StampClockOptions& stamps)
    : camera_(std::move(camera)), clock_(clock), exclusive_(exclusive), stamp_options_(stamps) {}

void DeviceStreams::set(Stream kind, std::unique_ptr<DeviceStream> stream) {
  Eye& one = eyes_.try_emplace(kind, Eye{nullptr, StampClock(stamp_options_)}).first->second;
  one.device = std::move(stream);
}

void DeviceStreams::drop() {
  for (auto& [kind, one] : eyes_) one.device.reset();
}

DeviceStreams::Eye& DeviceStreams::eye(Stream kind) {
  const auto found = eyes_.find(kind);
  if (found == eyes_.end())
    throw std::invalid_argument("camera '" + camera_ + "' has no " + toString(kind) + " stream");
  return found->second;
}

void DeviceStreams::activate(Stream kind) {
  Eye& wanted = eye(kind);
  if (wanted.device->isRunning()) return;
  for (auto& [other, one] : eyes_) {
    if (excludes(kind, other) && one.device) one.device->stop();
  }
  wanted.device->start();
  wanted.started = clock_.now();
  wanted.base = wanted.sequence;
}

void DeviceStreams::stopAll() {
  for (auto& [kind, one] : eyes_) {
    if (one.device) one.device->stop();
  }
}

std::optional<Frame> DeviceStreams::newest(Stream kind, bool waited) {
  Eye& from = eye(kind);
  std::optional<DeviceStream::Image> image = from.device->newest();
  if (!image) return std::nullopt;
  const Instant received = image->received.value_or(clock_.now());
  // One that lay there already says nothing about how long it took: it must not relate the clocks.
  if (!from.is_related && !waited && !image->received) return std::nullopt;
  from.is_related = true;
  Frame frame;
  frame.stream = kind;
  frame.received = received;
  frame.device_stamp_s = image->device_stamp_s;
  frame.stamp = from.stamps.read(frame.device_stamp_s, received).stamp;
  // Exposed before the stream was switched on: left over from the time before, or still settling.
  if (exclusive_ && frame.stamp < from.started) return std::nullopt;
  std::uint64_t number = from.base + image->number;
  if (number <= from.sequence) {
    from.base += from.sequence + 1 - number;
    number = from.sequence + 1;
  }
  frame.sequence = from.sequence = number;
  frame.image = std::move(image->pixels);
  return frame;
}

std::optional<Frame> DeviceStreams::next(Stream kind, Instant deadline,
                                         const std::function<void()>& demand_presence) {
  (void)eye(kind);
  for (bool waited = false;; waited = true) {
    demand_presence();
    activate(kind);
    if (auto frame = newest(kind, waited)) return frame;
    if (clock_.now() >= deadline) return std::nullopt;
    clock_.sleepUntil(std::min(deadline, clock_.now() + kPoll));
  }
}

}  // namespace servocal::sensor
