// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace servocal::session {

/// Names (relative to `folder`) of the files that match a shell pattern, in natural order.
std::vector<std::string> matchingFiles(const std::filesystem::path& folder, const std::string& pattern);

/// True if `a` comes first when runs of digits compare as numbers: "2.png" before "10.png".
bool naturallyBefore(const std::string& a, const std::string& b);

}  // namespace servocal::session
