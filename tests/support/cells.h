// SPDX-License-Identifier: GPL-3.0-or-later
// Cells that tests share; more in tests/data/cells.
#pragma once

#include "servocal/core/cell_config.h"

namespace servocal::test {

/// A simulated UR5 with the board on its flange and one color camera like a Kinect v2's in front of it.
inline CellConfig oneCameraCell() { return loadCell(SERVOCAL_CELLS "/one_camera.yaml"); }

}  // namespace servocal::test
