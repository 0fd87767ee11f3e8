// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "json.h"
#include "servocal/core/joint_result.h"

namespace servocal::report {

/// The joint estimate's part of the page.
Json jointData(const JointResult& joint);

}  // namespace servocal::report
