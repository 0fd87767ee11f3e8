// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "corner_fit.h"
#include "lattice.h"
#include "placement.h"
#include "servocal/core/board_spec.h"
#include "warp.h"

namespace servocal::board {

/// A whole grid of measured corners, still in the image's own order: u runs over `columns`, v over `rows`,
/// and v is u turned by +90 degrees from x towards y.
struct Grid {
  int columns = 0;
  int rows = 0;
  std::vector<CornerFit> corners;  ///< Row by row; each with the blur it was found to have by itself.
  Warp warp;
  Eigen::Vector2d blur_px;         ///< Median blur across edges along u and along v.
  double step = 0.0;               ///< Median brightness step of the corners (half of white minus black).

  const CornerFit& at(int column, int row) const { return corners[row * columns + column]; }
  /// Smallest distance between neighboring parallel edges, px.
  double smallestSpacing() const;
};

/// Measures every corner of a placement to sub-pixel accuracy. `scale` is the lattice's level: one of its
/// pixels is `scale` pixels of `gray`. Nothing if a corner cannot be measured or the corners do not lie on
/// a smoothly distorted plane.
/// At the grid's four corners the window leaves out what a hollow square would disturb.
std::optional<Grid> measureGrid(const cv::Mat& gray, const Checkerboard& board, const Lattice& lattice,
                                double scale, const Placement& placement);

/// Measures corners of the grid again with the whole window, where the square outside is known to be
/// solid. `solid` holds (u, v) signs of the grid's corner: (-1,-1) is the cell beyond (0,0).
void remeasureBesideSolid(const cv::Mat& gray, const std::vector<Eigen::Vector2i>& solid, Grid& grid);

}  // namespace servocal::board
