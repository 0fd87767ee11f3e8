// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string_view>

namespace servocal::report {

std::string_view pageTemplate();
std::string_view pageStyle();
std::string_view pageScript();  ///< Our code, Vega and three.js in one.

}  // namespace servocal::report
