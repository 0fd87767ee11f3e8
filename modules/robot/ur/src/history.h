// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <deque>

#include "servocal/core/observation.h"

namespace servocal::robot::ur {

/// The arm's states of the last seconds.
class History {
 public:
  void push(const RobotState& state);
  bool empty() const { return states_.empty(); }
  const RobotState& newest() const { return states_.back(); }
  /// Between its neighbors: joints, position and twist linearly, rotation along the shortest arc. The newest
  /// or oldest state outside.
  RobotState at(Instant stamp) const;

 private:
  std::deque<RobotState> states_;
};

}  // namespace servocal::robot::ur
