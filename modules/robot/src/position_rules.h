// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "motion.h"
#include "servocal/robot/collision.h"
#include "servocal/robot/guard.h"
#include "servocal/robot/kinematics.h"
#include "twist_limits.h"

namespace servocal::robot {

/// Which rule says no, and why.
struct Objection {
  GuardRule rule = GuardRule::kNone;
  std::string reason;
};

/// Where the arm may be: boxes and obstacles for flange and board, margins for joints, and, with a collision
/// model, room for the links.
class PositionRules {
 public:
  PositionRules(const Kinematics& kinematics, const MotionLimits& limits, const BoardSpec& board,
                const GuardOptions& options, std::optional<CollisionModel> links);
  void setBoard(const std::optional<Pose<EndEffector, Board>>& eMo);
  void setObstacles(const std::vector<Sphere>& obstacles);
  const Body& body() const { return body_; }

  /// With at least `room_m` between everything and what it must not enter.
  std::optional<Objection> at(const Pose<Base, EndEffector>& bMe, double room_m = 0.0) const;
  std::optional<Objection> at(const Eigen::VectorXd& q, double room_m = 0.0) const;
  /// Follows the curve of `motion` held for `hold_s` seconds and then braked to rest. No joint of the arm is
  /// farther than `reach_rad` from where the state says.
  std::optional<Objection> along(const RobotState& state, const Motion& motion, double hold_s,
                                 double reach_rad) const;

 private:
  struct Depths;
  Depths depths(const Pose<Base, EndEffector>& bMe) const;
  Objection boxObjection(const Depths& depths, Eigen::Index worst, double room_m = 0.0) const;
  std::optional<Objection> jointObjection(const Eigen::VectorXd& q, const Eigen::VectorXd& start) const;
  std::optional<Objection> boxObjection(const Depths& start, const Depths& before, const Depths& here) const;

  const Kinematics& kinematics_;
  MotionLimits limits_;
  BoardSpec board_;
  double link_clearance_m_;
  std::optional<CollisionModel> links_;
  std::vector<Sphere> obstacles_;
  Body body_;
};

}  // namespace servocal::robot
