// SPDX-License-Identifier: GPL-3.0-or-later
// What may be wrong with an arm's geometry, as the joint solve takes it.
#pragma once

#include <optional>
#include <vector>

#include "servocal/calib/joint.h"
#include "servocal/core/cell_config.h"

namespace servocal::procedure {

/// Offsets of the inner joints, and of every link its length, its twist and its offset along the axis (where
/// neighboring axes are parallel, its tilt instead): all that a calibration can tell of a chain whose base
/// and flange are free anyway, 18 numbers for six joints. Their priors are in the proportion of a length to an angle at
/// half a metre, and of such a size that all together, at these stops, move the flange by the arm's declared accuracy
/// (beyond what other poses of base and flange would do). The prior counts: with lengths of links and the size of the
/// board both free, it says how far the arm is a ruler.
///
/// The kinematics are those of the arm's description; the poses that the robot reports stand. Nothing for an
/// arm of fewer than two joints. Every RobotState must hold the angles of all of the arm's joints.
///
/// Sources: Denavit & Hartenberg 1955; parallel axes after Hayati, "Robot arm geometric link parameter
/// estimation", CDC 1983; the count after Mooring, Roth, Driels, "Fundamentals of Manipulator Calibration",
/// 1991.
///
/// @throws Error (kInvalidConfig) if the description cannot be read.
std::optional<calib::RobotTerms> armTerms(const ArmConfig& arm, const std::vector<Observation>& stops);

}  // namespace servocal::procedure
