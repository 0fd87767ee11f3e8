// SPDX-License-Identifier: GPL-3.0-or-later
// What the page fetches, as JSON.
#pragma once

#include <string>

#include "mailbox.h"
#include "servocal/core/cell_config.h"

namespace servocal::live {

/// Everything but the images.
std::string stateJson(const Snapshot& snapshot, const CellConfig& cell);

/// One look: the image as a JPEG at most 960 px wide in a data URL, and what lies over it, in px of the
/// camera's image.
std::string lookJson(const NumberedLook& numbered);

}  // namespace servocal::live
