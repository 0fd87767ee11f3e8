// SPDX-License-Identifier: GPL-3.0-or-later
// Which pixels show the board, and where on it, from the corners found in an image.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"

namespace servocal::board {

/// A pixel that shows the board.
struct BoardPixel {
  int column = 0;
  int row = 0;
  Eigen::Vector2d ray;     ///< (X/Z, Y/Z) in the camera.
  Eigen::Vector2d place_o; ///< Where on the board, m.
};

struct BoardArea {
  Eigen::Vector3d plane;          ///< Expected 1/z = plane . (x, y, 1) for a ray (x, y), 1/m.
  std::vector<BoardPixel> pixels;
  Eigen::Vector2d min_o, max_o;   ///< Extent of the used outline on the board, m.
};

/// The pattern (of a board seen in part, the hull of its seen corners) less `erode_px` at its outline; with
/// `white_only` less the black print and a pixel around it. Nothing if the corners do not determine a plane.
/// @throws std::invalid_argument if a corner id is not the board's.
std::optional<BoardArea> boardArea(const BoardSpec& board, const CameraModel& camera,
                                   const BoardDetection& detection, double erode_px, bool white_only);

}  // namespace servocal::board
