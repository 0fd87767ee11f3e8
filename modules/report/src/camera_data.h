// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

#include "json.h"
#include "servocal/report/report.h"

namespace servocal::report {

/// One camera of report.json.
Json cameraData(const ReportInput& input, const CameraResult& camera);

/// How a camera stands beside another.
Json pairData(const CameraPair& pair, const std::string& first, const std::string& second);

}  // namespace servocal::report
