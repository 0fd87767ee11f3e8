// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "lattice.h"
#include "servocal/core/board_spec.h"

namespace servocal::board {

/// Where a board could lie in a lattice: node (i0, j0) is its first corner.
struct Placement {
  int i0 = 0, j0 = 0;
  int columns = 0, rows = 0;
  int present = 0;  ///< Corners the lattice has; the rest must be found by prediction.
};

/// Placements of the board in either order of its dimensions, best first. None where the lattice
/// visibly goes on beyond the board.
std::vector<Placement> findPlacements(const Lattice& lattice, const Checkerboard& board);

}  // namespace servocal::board
