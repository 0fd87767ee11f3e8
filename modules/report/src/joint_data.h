// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "json.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/joint_result.h"

namespace servocal::report {

/// The joint estimate's part of the page; `goals` are those of a run whose views follow from information.
Json jointData(const JointResult& joint, const std::optional<PlannerConfig>& goals);

}  // namespace servocal::report
