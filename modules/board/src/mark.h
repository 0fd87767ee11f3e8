// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "grid.h"
#include "servocal/core/board_spec.h"

namespace servocal::board {

/// How the board lies in a grid: board corner (x, y) is the grid's corner() of it.
struct Turn {
  int quarters = 0;  ///< Board x runs along u (0), v (1), -u (2), -v (3).

  /// (column, row) of board corner (x, y) in a grid of `columns` x `rows`.
  Eigen::Vector2i corner(int x, int y, int columns, int rows) const;
  /// (u, v) signs of the grid's corner that is board corner 0.
  Eigen::Vector2i firstCorner() const;
};

enum class MarkStatus {
  kFound,        ///< One turn, and the picture proves it.
  kUndecided,    ///< Several turns fit; nothing tells them apart.
  kImpossible,   ///< No turn fits: wrong colors, or a mirror image.
};

struct MarkResult {
  MarkStatus status = MarkStatus::kImpossible;
  std::vector<Turn> turns;  ///< One if found, all that fit if undecided.
};

/// Decides how the board lies from its colors and, if it has one, from its hollow corner square. The
/// square's picture is compared with the picture a hollow and a solid one would give at this blur.
MarkResult findTurn(const cv::Mat& gray, const Grid& grid, const Checkerboard& board);

}  // namespace servocal::board
