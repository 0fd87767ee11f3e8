// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "servocal/robot/guard.h"
#include "servocal/robot/kinematics.h"

namespace servocal::robot {

struct PathOptions {
  double step_rad = 0.02;          ///< Largest joint motion between two looks at whether the arm may be there.
  double joint_margin_rad = 0.05;  ///< Kept from the joint limits.
  int max_iterations = 3000;       ///< Of the search, before it gives up. Not a time: plans must repeat.
};

/// A way for the arm from one configuration to another on which `free` holds: corner points in joint angles
/// (rad), to be joined by straight lines, from `from` to `to`. Short-cut after the search. Nothing if either
/// end is not free or none was found in max_iterations. Always the same for the same question. Angles never wrap round: cables do not either.
///
/// Source: RRT-Connect, Kuffner & LaValle, ICRA 2000; as implemented by OMPL.
///
/// @throws std::invalid_argument unless both ends have one finite angle per joint.
std::optional<std::vector<Eigen::VectorXd>> planPath(const Kinematics& kinematics,
                                                     const std::function<bool(const Eigen::VectorXd&)>& free,
                                                     const Eigen::VectorXd& from, const Eigen::VectorXd& to,
                                                     const PathOptions& options = {});

/// Postures of the arm (elbow up or down, wrist turned, ...) that reach a flange pose: joint angles inside the
/// limits by `margin_rad`, each on the turn nearest to `from`, the nearest posture first (largest joint motion).
/// Found by Kinematics::inverse from fixed starts all around: most, not surely all; a redundant arm has
/// infinitely many.
/// @throws std::invalid_argument as Kinematics::inverse.
std::vector<Eigen::VectorXd> postures(const Kinematics& kinematics, const Pose<Base, EndEffector>& bMe,
                                      const Eigen::VectorXd& from, double margin_rad = 0.0);

struct PlanOptions {
  PathOptions search;
  double room_m = 0.01;  ///< Kept from what the guard objects to, beyond its own clearance: a follower is not exact.
};

struct Plan {
  std::vector<Eigen::VectorXd> path;  ///< As of planPath(), from where the arm stands; empty if there is none.
  std::string reason;                 ///< Why there is none: a sentence for the operator.
};

/// A way to a flange pose that the guard will allow, in the posture that is cheapest to go to (largest joint
/// motion, summed along the path). For servo::followPath(). If less than room_m is free where the arm stands,
/// the whole way makes do with the guard's own clearance.
/// @throws std::invalid_argument unless `from` has one finite angle per joint and the pose is finite.
Plan planTo(const Guard& guard, const Eigen::VectorXd& from, const Pose<Base, EndEffector>& bMe,
            const PlanOptions& options = {});

}  // namespace servocal::robot
