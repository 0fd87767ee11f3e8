// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

namespace servocal::live {

/// The page, its script and style allowed by `nonce`.
std::string pageWith(const std::string& nonce);

}  // namespace servocal::live
