// SPDX-License-Identifier: GPL-3.0-or-later
#include "motion_record.h"

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace servocal::sim {
namespace {

/// The steady clock's reading at which the run's clock is at zero.
std::int64_t zeroOf(const Clock& clock) {
  std::int64_t latest = std::numeric_limits<std::int64_t>::min();
  for (int i = 0; i < 5; ++i) {  // Whatever comes between the two readings makes it earlier.
    const auto steady = std::chrono::steady_clock::now().time_since_epoch();
    const auto run = clock.now().time_since_epoch();
    latest = std::max<std::int64_t>(latest, (std::chrono::nanoseconds(steady) - run).count());
  }
  return latest;
}

ArmMoment momentOf(const MotionStep& step) {
  ArmMoment moment;
  moment.q = Eigen::Map<const Eigen::Matrix<double, 6, 1>>(step.q);
  moment.bMe = Pose<Base, EndEffector>::fromQuaternion(Eigen::Map<const Eigen::Quaterniond>(step.quaternion),
                                                       Eigen::Map<const Eigen::Vector3d>(step.position_m));
  moment.travelled_rad = step.travelled_rad;
  return moment;
}

ArmMoment between(const MotionStep& a, const MotionStep& b, double share) {
  const ArmMoment from = momentOf(a), to = momentOf(b);
  ArmMoment moment = from;
  moment.q += share * (to.q - from.q);
  moment.bMe = Pose<Base, EndEffector>::fromQuaternion(
      from.bMe.quaternion().slerp(share, to.bMe.quaternion()),
      from.bMe.translation() + share * (to.bMe.translation() - from.bMe.translation()));
  moment.travelled_rad += share * (to.travelled_rad - from.travelled_rad);
  return moment;
}

}  // namespace

void MotionRecord::push(const MotionStep& step) {
  const std::uint64_t next = written_.load(std::memory_order_relaxed);
  steps_[next % kSteps] = step;
  written_.store(next + 1, std::memory_order_release);
}

RecordedMotion::RecordedMotion(const MotionRecord& record, const Clock& clock)
    : record_(record), clock_zero_ns_(zeroOf(clock)) {
  if (record.size() == 0) throw std::invalid_argument("RecordedMotion: the record is empty");
}

ArmMoment RecordedMotion::at(Instant instant) {
  const std::int64_t at_ns = clock_zero_ns_ + instant.time_since_epoch().count();
  std::uint64_t end = record_.size();
  std::uint64_t begin = end > MotionRecord::kSteps / 2 ? end - MotionRecord::kSteps / 2 : 0;
  const std::uint64_t first = begin, last = end - 1;
  while (begin < end) {  // The first step after the instant.
    const std::uint64_t middle = begin + (end - begin) / 2;
    if (record_.step(middle).steady_ns <= at_ns)
      begin = middle + 1;
    else
      end = middle;
  }
  if (begin == first) return momentOf(record_.step(first));
  if (begin > last) return momentOf(record_.step(last));
  const MotionStep &a = record_.step(begin - 1), &b = record_.step(begin);
  return between(a, b,
                 static_cast<double>(at_ns - a.steady_ns) / static_cast<double>(b.steady_ns - a.steady_ns));
}

}  // namespace servocal::sim
