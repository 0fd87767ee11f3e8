// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "servocal/robot/guard.h"
#include "servocal/robot/kinematics.h"
#include "twist_limits.h"

namespace servocal::robot {

/// Which rule says no, and why.
struct Objection {
  GuardRule rule = GuardRule::kNone;
  std::string reason;
};

/// Where the arm may be: boxes for flange and board, margins for joints.
class PositionRules {
 public:
  PositionRules(const Kinematics& kinematics, const MotionLimits& limits, const BoardSpec& board,
                double unknown_board_radius_m);
  void setBoard(const std::optional<Pose<EndEffector, Board>>& eMo);
  const Body& body() const { return body_; }

  std::optional<Objection> at(const Pose<Base, EndEffector>& bMe) const;
  std::optional<Objection> at(const Eigen::VectorXd& q) const;
  /// Follows the curve of `twist` held for `hold_s` seconds and then braked to rest.
  std::optional<Objection> along(const RobotState& state, const Twist<Base>& twist, double hold_s) const;

 private:
  struct Depths;
  Depths depths(const Pose<Base, EndEffector>& bMe) const;
  Objection boxObjection(const Depths& depths, Eigen::Index worst) const;

  const Kinematics& kinematics_;
  MotionLimits limits_;
  BoardSpec board_;
  Body body_;
};

}  // namespace servocal::robot
