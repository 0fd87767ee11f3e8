// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "json.h"
#include "servocal/report/report.h"

namespace servocal::report {

/// The run from its begin to its end: drives, stages, and what was said, stopped and failed. Parts of a run
/// that was interrupted and resumed follow each other.
Json timelineData(const ReportInput& input);

}  // namespace servocal::report
