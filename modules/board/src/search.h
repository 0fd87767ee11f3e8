// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "grid.h"
#include "mark.h"
#include "servocal/core/board_spec.h"

namespace servocal::board {

/// A board in an image, with every way it may lie.
struct Found {
  Grid grid;
  MarkResult mark;
};

/// Halves an image; pixel (x, y) of the result covers pixels (2x..2x+1, 2y..2y+1).
cv::Mat halve(const cv::Mat& gray);

/// Looks for the board on the given pyramid levels in turn (level n is 2^n times smaller).
/// `rim_squares`: width of the white rim around the squares, in squares.
std::optional<Found> searchBoard(const cv::Mat& gray, const Checkerboard& board, double rim_squares,
                                 const std::vector<int>& levels);

}  // namespace servocal::board
