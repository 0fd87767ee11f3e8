// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>

namespace servocal {

/// The whole text of a configuration file.
/// @throws Error (kInvalidConfig) naming the file and why it cannot be read.
std::string readConfigText(const std::filesystem::path& file);

}  // namespace servocal
