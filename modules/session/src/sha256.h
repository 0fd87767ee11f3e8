// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace servocal::session {

/// As the program sha256sum prints it: 64 hexadecimal digits.
std::string sha256(const void* data, std::size_t size);

}  // namespace servocal::session
