// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <urdf_parser/urdf_parser.h>

#include <vector>

#include "servocal/core/cell_config.h"

namespace servocal::robot {

/// The serial chain of an arm, read from its URDF and checked: every joint turns within limits or is fixed.
struct UrdfChain {
  urdf::ModelInterfaceSharedPtr model;
  std::vector<urdf::JointSharedPtr> joints;  ///< From the base link to the flange link.
};

/// `arm.urdf` is "ur5" (built in) or the path of a URDF file.
/// @throws Error (kInvalidConfig) if the URDF cannot be read, has no chain between the links, or has a joint
///   there that neither turns nor is fixed.
UrdfChain readChain(const ArmConfig& arm);

}  // namespace servocal::robot
