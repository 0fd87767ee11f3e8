// SPDX-License-Identifier: GPL-3.0-or-later
#include "mailbox.h"

#include <utility>

namespace servocal::live {
namespace {

constexpr std::size_t kServoSamples = 240;
constexpr std::size_t kSigmaSamples = 200;
constexpr std::size_t kMessages = 60;

template <class T>
void append(std::deque<T>& last, T value, std::size_t most) {
  last.push_back(std::move(value));
  if (last.size() > most) last.pop_front();
}

}  // namespace

void Mailbox::put(const procedure::Event& event) {
  const double at_s = toSeconds(event.stamp);
  const std::lock_guard lock(mutex_);
  newest_.event = event;
  if (!event.message.empty())
    append(newest_.messages, {at_s, event.camera + ": " + event.message}, kMessages);
  for (const procedure::EyeProgress& eye : event.eyes) {
    if (!eye.sigma_m) continue;
    auto& samples = newest_.sigma[{eye.camera, eye.stream}];
    if (samples.empty() || samples.back().sigma_m != *eye.sigma_m) {
      append(samples, {at_s, *eye.sigma_m}, kSigmaSamples);
    }
  }
}

void Mailbox::put(const procedure::Look& look) {
  auto numbered = std::make_shared<NumberedLook>();
  numbered->look = look;
  std::shared_ptr<const NumberedLook> last;  // Let go after the lock: it may be the last to hold the image.
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock.owns_lock()) return;
  numbered->number = ++looks_;
  auto& slot = newest_.looks[{look.camera, look.frame.stream}];
  last = std::exchange(slot, std::move(numbered));
  ServoSample sample;
  sample.at_s = toSeconds(look.arm.stamp);
  sample.error_px = look.error_px;
  sample.speed_mps = look.arm.twist.linear_mps.norm();
  if (const auto& wanted = look.arm.guard.wanted) sample.wanted_mps = wanted->linear_mps.norm();
  sample.turn_radps = look.arm.twist.angular_radps.norm();
  append(newest_.servo, sample, kServoSamples);
}

void Mailbox::put(const Ending& ending) {
  const std::lock_guard lock(mutex_);
  newest_.ending = ending;
}

Snapshot Mailbox::snapshot() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

std::shared_ptr<const NumberedLook> Mailbox::look(const EyeName& eye) const {
  const std::lock_guard lock(mutex_);
  const auto found = newest_.looks.find(eye);
  return found == newest_.looks.end() ? nullptr : found->second;
}

}  // namespace servocal::live
