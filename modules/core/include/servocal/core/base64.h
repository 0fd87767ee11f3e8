// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace servocal {

/// RFC 4648, padded; what data URLs take.
std::string base64(const std::vector<std::uint8_t>& bytes);

}  // namespace servocal
