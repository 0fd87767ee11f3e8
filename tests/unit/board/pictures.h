// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Cholesky>

#include "board_picture.h"
#include "servocal/core/observation.h"

namespace servocal::test {

inline BoardSpec plainBoard(int squares_x, int squares_y) {
  Checkerboard plain;
  plain.squares_x = squares_x;
  plain.squares_y = squares_y;
  plain.hollow_corner = false;
  return BoardSpec{plain};
}

/// RMS distance between found and true corners of the same id, px. `shift_px` moves what was found.
inline double rmsPx(const BoardDetection& detection, const std::vector<Eigen::Vector2d>& truth,
                    const Eigen::Vector2d& shift_px = Eigen::Vector2d::Zero()) {
  double sum = 0;
  for (const Corner& corner : detection.corners) sum += (corner.pixel + shift_px - truth[corner.id]).squaredNorm();
  return std::sqrt(sum / detection.corners.size());
}

/// The same if the ids are those of the board turned by half a turn.
inline double rmsTurnedPx(const BoardDetection& detection, std::vector<Eigen::Vector2d> truth) {
  std::reverse(truth.begin(), truth.end());
  return rmsPx(detection, truth);
}

}  // namespace servocal::test
