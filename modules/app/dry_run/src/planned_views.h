// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "servocal/app_dry_run/dry_run.h"
#include "servocal/plan/next_view.h"
#include "servocal/robot/collision.h"
#include "servocal/robot/guard.h"

namespace servocal::app {

/// Where the plan has come to: the arm's place and the time.
class Pencil {
 public:
  Pencil(const robot::Guard& guard, const robot::CollisionModel& bodies, const Eigen::VectorXd& q)
      : guard_(guard), bodies_(bodies), q_(q) {}

  /// The stop at a flange pose, and the pencil moved there if the arm may be there.
  PlannedStop goTo(const std::string& what, const Pose<Base, EndEffector>& bMe);
  PlannedStop goTo(const std::string& what, const Eigen::VectorXd& q);

  const robot::Guard& guard() const { return guard_; }
  const Eigen::VectorXd& q() const { return q_; }
  double timeS() const { return time_s_; }
  void wait(double seconds) { time_s_ += seconds; }

 private:
  void measure(PlannedStop& stop, const Eigen::VectorXd& q) const;
  double travelS(const Pose<Base, EndEffector>& from, const Pose<Base, EndEffector>& to) const;

  const robot::Guard& guard_;
  const robot::CollisionModel& bodies_;
  Eigen::VectorXd q_;
  double time_s_ = 0.0;
};

/// One camera's turn: facing it for the tilt search, coverage, revisits, check views.
PlannedCamera planCamera(const CellConfig& cell, const CameraConfig& camera, const plan::Belief& belief,
                         Pencil& pencil);

}  // namespace servocal::app
