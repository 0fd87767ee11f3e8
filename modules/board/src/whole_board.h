// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>

#include "grid.h"
#include "servocal/core/board_spec.h"

namespace servocal::board {

/// True if a measured grid is the board and nothing but it: four squares meet in every corner, they are squares
/// and not dots, colors alternate as on a checkerboard, and every side ends in a white rim (`rim_squares` wide),
/// not in more squares.
bool isWholeBoard(const cv::Mat& gray, const Grid& grid, const Checkerboard& board, double rim_squares);

}  // namespace servocal::board
