// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>

#include "servocal/core/cell_config.h"

namespace servocal::session {

/// What the keys of a cell file were resolved to, defaults included, as JSON; units in the keys. Without the
/// board (kept by itself) and without a simulated cell's truth.
std::string resolvedCell(const CellConfig& cell);

/// Of a URDF that is a file; nothing for a built-in one.
/// @throws Error (kBadData) if it cannot be read.
std::optional<std::string> urdfText(const CellConfig& cell);

}  // namespace servocal::session
