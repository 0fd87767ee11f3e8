// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

namespace servocal::report {

/// The report as one HTML file that needs nothing else, offline too: charts, 3D view and `json` (of
/// reportJson) are inside, and its content security policy forbids every request. Part of the target
/// servocal::report_page.
std::string reportPage(const std::string& json);

}  // namespace servocal::report
