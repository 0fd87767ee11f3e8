// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <vector>

#include "position_rules.h"
#include "servocal/robot/collision.h"

namespace servocal::robot {

/// Why these gaps are not enough; nothing if they are.
std::optional<Objection> linkObjection(const std::vector<CollisionModel::Gap>& gaps, double clearance_m);

/// Looks at the links along a curve, no oftener than anything can have happened.
///
/// A pair that is too near at the start may go apart, never nearer.
class LinkWatch {
 public:
  LinkWatch(const CollisionModel& model, const Eigen::VectorXd& start, double clearance_m);
  /// The next configuration of the curve; the last one is always looked at.
  std::optional<Objection> moveTo(const Eigen::VectorXd& q, bool last);

 private:
  double freeWay() const;

  const CollisionModel& model_;
  double clearance_m_;
  std::vector<CollisionModel::Gap> start_, before_;
  Eigen::VectorXd q_;
  double moved_m_ = 0.0;  // Since the last look.
};

}  // namespace servocal::robot
