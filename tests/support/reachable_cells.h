// SPDX-License-Identifier: GPL-3.0-or-later
// Which image cells a board on the arm can fill at all, decided from the truth of a simulated cell.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"
#include "sim_truth.h"

namespace servocal::test {

/// A board pose that fills an image cell.
struct FillingView {
  Pose<Color, Board> cMo;       ///< In the camera of ReachSearch::stream.
  Eigen::VectorXd q;            ///< Joint angles that take the board there, rad.
  int corners_in_cell = 0;
};

struct ReachableCells {
  int cells_x = 0;
  int cells_y = 0;
  std::vector<std::optional<FillingView>> cells;  ///< Row by row; nothing if out of reach.

  int count() const;
  double fraction() const { return static_cast<double>(count()) / static_cast<double>(cells.size()); }
  bool reachable(int column, int row) const { return cells[row * cells_x + column].has_value(); }
};

/// Board poses to try.
struct ReachSearch {
  double nearest_m = 0.35;   ///< Distance of the board's centre along the optical axis.
  double farthest_m = 0.90;
  double max_tilt_rad = 0.70;
  Stream stream = Stream::kColor;  ///< Whose image; a depth camera's own range is not asked for.
};

/// For every image cell of `config.coverage`: is there a board pose with all corners inside the image
/// and at least corners_per_cell of them in that cell, whose flange and board obey workspace and keep-out
/// boxes (as the guard checks them: flange origin and board corners), and which the arm reaches within
/// its joint limits? Deterministic. A "no" means that no pose of a grid over distance, tilt, roll and
/// position did.
ReachableCells reachableCells(const CellConfig& config, const sim::Truth& truth, const std::string& camera,
                              const ReachSearch& search = {});

}  // namespace servocal::test
