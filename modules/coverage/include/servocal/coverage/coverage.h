// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"
#include "servocal/core/result.h"

namespace servocal::coverage {

/// How the board leans against the image plane: its normal turned about the image's x axis (pitch) or
/// y axis (yaw), by the larger of the two.
enum class TiltBin { kFrontal, kPitchPlus, kPitchMinus, kYawPlus, kYawMinus };
inline constexpr std::array<TiltBin, 5> kTiltBins = {
    TiltBin::kFrontal, TiltBin::kPitchPlus, TiltBin::kPitchMinus, TiltBin::kYawPlus, TiltBin::kYawMinus};
const char* toString(TiltBin bin);  ///< "frontal", "pitch+", ...
/// Leaning less than 12 degrees is frontal.
TiltBin tiltBinOf(const Pose<Color, Board>& cMo);

/// Marginal goals beside the image cells; counts of views, not a product of bins.
struct ViewGoals {
  int near_views = 6;
  int far_views = 6;
  int views_per_tilt_bin = 3;
};

/// What one camera stream has seen of the board, and what is missing: image cells filled with corners,
/// two distances, tilts. Knows no robot and no image.
class Coverage {
 public:
  /// @param region of the image over which the grid lies: all of it, or the part that matters.
  /// @throws std::invalid_argument if the region or the grid is empty.
  Coverage(const CoverageConfig& config, const ImageRegion& region, const ViewGoals& goals = {});

  /// Counts a view: its corners' pixels and the board's pose.
  void add(const std::vector<Eigen::Vector2d>& pixels, const Pose<Color, Board>& cMo);
  /// Marks a cell as out of reach; it counts as done from now on.
  void giveUp(int cell);
  /// Marks the distances and tilts that still lack views as out of reach; they count as done from now on.
  void giveUpMarginals();
  /// Leaves a cell alone from now on though the arm reaches it: the board was lost or not found there. It
  /// stays missing unless other views fill it.
  void setAside(int cell);
  /// The same for the distances and tilts that still lack views.
  void setMarginalsAside() { marginals_aside_ = true; }

  int cells() const { return config_.cells_x * config_.cells_y; }
  /// Cell (row by row from the upper left) that holds the pixel; nothing outside the region.
  std::optional<int> cellAt(const Eigen::Vector2d& pixel) const;
  Eigen::Vector2d cellCenter(int cell) const;
  bool filled(int cell) const { return corners_[cell] >= config_.corners_per_cell; }
  bool givenUp(int cell) const { return given_up_[cell]; }
  int filledCells() const;
  /// Cells neither filled, given up nor set aside, from the region's centre outward.
  std::vector<int> openCells() const;
  /// Far: at least distance_ratio times the wanted near distance.
  bool isFar(const Pose<Color, Board>& cMo) const;

  /// Corners that the cell still lacks; 0 if filled.
  int missingToFill(int cell) const { return std::max(0, config_.corners_per_cell - corners_[cell]); }
  /// Corners and views that are missing in all but what was set aside; falls with every view that helped.
  int deficit() const;
  /// Corners a view would add where they are missing, over all open cells.
  int missingCorners(const std::vector<Eigen::Vector2d>& pixels) const;
  /// Views still missing in the marginals that this pose belongs to: 0, 1 (distance or tilt) or 2.
  int missingMarginals(const Pose<Color, Board>& cMo) const;
  /// True when no cell is open and nothing was set aside that is still missing, and the marginals are met.
  bool complete() const;
  /// True when there is nothing more to drive to: complete but for what was set aside.
  bool exhausted() const { return deficit() == 0; }
  /// What complete() lacks, a sentence each.
  std::vector<std::string> missing() const;

  CoverageSummary summary() const;

 private:
  CoverageConfig config_;
  ImageRegion region_;
  int near_goal_;
  int far_goal_;
  std::array<int, kTiltBins.size()> tilt_goals_{};
  std::vector<int> corners_;
  std::vector<bool> given_up_;
  std::vector<bool> aside_;
  bool marginals_aside_ = false;
  int near_views_ = 0;
  int far_views_ = 0;
  std::array<int, kTiltBins.size()> tilt_views_{};
  std::vector<std::string> out_of_reach_;
};

}  // namespace servocal::coverage
