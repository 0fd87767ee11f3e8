// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "json.h"
#include "servocal/report/report.h"

namespace servocal::report {

/// One camera of report.json. `best` is the same with the numbers to work with (bestEstimate), of which color and depth are
/// drawn together.
Json cameraData(const ReportInput& input, const CameraResult& camera, const CameraResult& best);

/// How a camera stands beside another.
Json pairData(const CameraPair& pair, const std::string& first, const std::string& second);

}  // namespace servocal::report
