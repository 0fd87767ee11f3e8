// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "tags.h"

namespace servocal::board {

/// A tag as measured.
struct TagFit {
  TagCorners corners;
  std::array<Eigen::Matrix2d, 4> covariances_px2;  ///< From noise, contrast and length of the edges.
  double black = 0.0, white = 0.0;                 ///< Brightness of border and surroundings, gray levels.
};

/// Measures a tag's corners as the crossings of its sides' lines.
///
/// A corner that sticks out is rounded by blur, so its picture does not say where it is; the straight
/// sides do. Each line is fitted to the brightness across it, white to black as an error function, over
/// the pixels near the side but not near its ends (where another corner may touch: Kalibr's boards have
/// a square there). Long sides are fitted near each of their corners, where a lens bends them less.
///
/// `guess` may be off by `search_px` (at most a cell). `cells_across`: cells along a side, of which the
/// black border takes `border_cells` at either end. Nothing if a side is not there.
std::optional<TagFit> fitTag(const cv::Mat& gray, const TagCorners& guess, int cells_across, int border_cells,
                             double search_px);

/// How many of a tag's `cells` (see tagCells) differ from what is seen between these corners.
int wrongCells(const cv::Mat& gray, const TagFit& tag, const cv::Mat& cells);

}  // namespace servocal::board
