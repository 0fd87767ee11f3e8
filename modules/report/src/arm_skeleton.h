// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

#include "servocal/report/report.h"

namespace servocal::report {

/// A line along an arm's links in b, from the base to the flange.
using ArmLine = std::vector<Eigen::Vector3d>;

/// The arm at the first stop and at a few more, far apart, for the drawing: through the joints' axes where
/// the next one is nearest, as Denavit and Hartenberg place their frames. Empty without a cell file or joint
/// angles.
std::vector<ArmLine> armLines(const ReportInput& input, int most);

}  // namespace servocal::report
