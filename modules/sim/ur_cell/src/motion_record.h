// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "servocal/sim/arm_motion.h"

namespace servocal::sim {

/// One step of the controller; plain numbers, for memory that two processes share.
struct MotionStep {
  std::int64_t steady_ns = 0;  ///< Of std::chrono::steady_clock, the same in all processes.
  double q[6] = {};
  double position_m[3] = {};
  double quaternion[4] = {0.0, 0.0, 0.0, 1.0};  ///< x y z w
  double travelled_rad = 0.0;
};

/// The last steps of the controller, written by its process and read by ours without waiting for each other:
/// the writer needs more than half a minute to come round to what a reader looks at.
class MotionRecord {
 public:
  static constexpr std::uint64_t kSteps = 1 << 14;

  void push(const MotionStep& step);
  std::uint64_t size() const { return written_.load(std::memory_order_acquire); }
  const MotionStep& step(std::uint64_t index) const { return steps_[index % kSteps]; }

 private:
  std::atomic<std::uint64_t> written_{0};
  MotionStep steps_[kSteps];
};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

/// The record by the run's clock.
class RecordedMotion final : public ArmMotion {
 public:
  RecordedMotion(const MotionRecord& record, const Clock& clock);
  ArmMoment at(Instant instant) override;

 private:
  const MotionRecord& record_;
  std::int64_t clock_zero_ns_;  ///< Of the steady clock.
};

}  // namespace servocal::sim
