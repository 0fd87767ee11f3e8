// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

#include "servocal/core/board_spec.h"

namespace servocal::board {

/// A filled shape of a board's print, in the board frame.
struct Shape {
  enum class Kind { kRectangle, kDisc };
  Kind kind = Kind::kRectangle;
  Eigen::Vector2d centre;     ///< m
  Eigen::Vector2d half_size;  ///< m; a disc's radius in both.
  bool black = true;
};

/// What is printed on the plate, in the order of painting: black on the white plate, white on black. Shapes
/// of one color that follow each other may touch and belong together.
/// @throws std::invalid_argument if a tag family is unknown or a code is not in it.
std::vector<Shape> artwork(const BoardSpec& board);

}  // namespace servocal::board
