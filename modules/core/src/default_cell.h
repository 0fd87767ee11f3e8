// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace servocal {

/// data/default_cell.yaml, embedded by the build.
extern const char* const kDefaultCellText;

}  // namespace servocal
