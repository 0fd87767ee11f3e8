// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/robot/kinematics.h"

namespace servocal::robot {

struct PathOptions {
  double step_rad = 0.02;          ///< Largest joint motion between two looks at whether the arm may be there.
  double joint_margin_rad = 0.05;  ///< Kept from the joint limits.
  Duration budget = std::chrono::seconds(2);  ///< Wall time after which the search gives up.
};

/// A way for the arm from one configuration to another on which `free` holds: corner points in joint angles
/// (rad), to be joined by straight lines, from `from` to `to`. Short-cut after the search. Nothing if either
/// end is not free or none was found in time. Angles never wrap round: cables do not either.
///
/// Source: RRT-Connect, Kuffner & LaValle, ICRA 2000; as implemented by OMPL.
///
/// @throws std::invalid_argument unless both ends have one finite angle per joint.
std::optional<std::vector<Eigen::VectorXd>> planPath(const Kinematics& kinematics,
                                                     const std::function<bool(const Eigen::VectorXd&)>& free,
                                                     const Eigen::VectorXd& from, const Eigen::VectorXd& to,
                                                     const PathOptions& options = {});

}  // namespace servocal::robot
