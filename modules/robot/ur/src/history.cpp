// SPDX-License-Identifier: GPL-3.0-or-later
#include "history.h"

#include <algorithm>
#include <chrono>

namespace servocal::robot::ur {
namespace {

constexpr Duration kKept = std::chrono::milliseconds(2500);  // robot::Arm promises one second.

}  // namespace

void History::push(const RobotState& state) {
  states_.push_back(state);
  while (states_.front().stamp + kKept < state.stamp) states_.pop_front();
}

RobotState History::at(Instant stamp) const {
  const auto after = std::upper_bound(states_.begin(), states_.end(), stamp,
                                      [](Instant at, const RobotState& state) { return at < state.stamp; });
  if (after == states_.begin()) return states_.front();
  if (after == states_.end()) return states_.back();
  const RobotState& b = *after;
  const RobotState& a = *(after - 1);
  const double share = toSeconds(stamp - a.stamp) / toSeconds(b.stamp - a.stamp);
  RobotState state = a;
  state.stamp = stamp;
  state.device_stamp_s += share * (b.device_stamp_s - a.device_stamp_s);
  state.q += share * (b.q - a.q);
  state.bMe = Pose<Base, EndEffector>::fromQuaternion(
      a.bMe.quaternion().slerp(share, b.bMe.quaternion()),
      a.bMe.translation() + share * (b.bMe.translation() - a.bMe.translation()));
  state.twist.linear_mps += share * (b.twist.linear_mps - a.twist.linear_mps);
  state.twist.angular_radps += share * (b.twist.angular_radps - a.twist.angular_radps);
  return state;
}

}  // namespace servocal::robot::ur
