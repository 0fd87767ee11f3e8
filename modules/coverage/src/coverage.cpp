// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/coverage/coverage.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace servocal::coverage {
namespace {

constexpr double kFrontalLimitRad = 12.0 * M_PI / 180.0;
constexpr const char* kLostHalfSentence =
    " given up because the board was lost or not found there, though the arm reaches it";

}  // namespace

const char* toString(TiltBin bin) {
  switch (bin) {
    case TiltBin::kFrontal: return "frontal";
    case TiltBin::kPitchPlus: return "pitch+";
    case TiltBin::kPitchMinus: return "pitch-";
    case TiltBin::kYawPlus: return "yaw+";
    case TiltBin::kYawMinus: return "yaw-";
  }
  return "unknown";
}

TiltBin tiltBinOf(const Pose<Color, Board>& cMo) {
  const Eigen::Vector3d normal = cMo.rotation().col(2);
  // A right-handed turn about x takes the normal (0,0,1) towards -y, one about y towards +x.
  const double pitch = std::atan2(-normal.y(), normal.z());
  const double yaw = std::atan2(normal.x(), normal.z());
  if (std::max(std::abs(pitch), std::abs(yaw)) < kFrontalLimitRad) return TiltBin::kFrontal;
  if (std::abs(pitch) >= std::abs(yaw)) return pitch > 0 ? TiltBin::kPitchPlus : TiltBin::kPitchMinus;
  return yaw > 0 ? TiltBin::kYawPlus : TiltBin::kYawMinus;
}

Coverage::Coverage(const CoverageConfig& config, const ImageRegion& region, const ViewGoals& goals)
    : config_(config), region_(region), near_goal_(goals.near_views), far_goal_(goals.far_views) {
  tilt_goals_.fill(goals.views_per_tilt_bin);
  if (region.width_px <= 0 || region.height_px <= 0) throw std::invalid_argument("coverage of an empty image");
  if (config.cells_x <= 0 || config.cells_y <= 0) throw std::invalid_argument("coverage with no cells");
  corners_.assign(cells(), 0);
  given_up_.assign(cells(), false);
  aside_.assign(cells(), false);
}

void Coverage::add(const std::vector<Eigen::Vector2d>& pixels, const Pose<Color, Board>& cMo) {
  for (const Eigen::Vector2d& pixel : pixels) {
    if (const auto cell = cellAt(pixel)) ++corners_[*cell];
  }
  ++(isFar(cMo) ? far_views_ : near_views_);
  ++tilt_views_[static_cast<std::size_t>(tiltBinOf(cMo))];
}

void Coverage::giveUp(int cell) { given_up_.at(cell) = true; }

void Coverage::setAside(int cell) { aside_.at(cell) = true; }

void Coverage::giveUpMarginals() {
  if (marginals_aside_) return;
  const auto lower = [&](int& wanted, int have, const std::string& what) {
    if (have >= wanted) return;
    wanted = have;
    out_of_reach_.push_back(what);
  };
  lower(near_goal_, near_views_, "near views");
  lower(far_goal_, far_views_, "far views");
  for (const TiltBin bin : kTiltBins) {
    const auto i = static_cast<std::size_t>(bin);
    lower(tilt_goals_[i], tilt_views_[i], std::string("tilt ") + toString(bin));
  }
}

std::optional<int> Coverage::cellAt(const Eigen::Vector2d& pixel) const {
  // Pixel centres are at integers, so an image spans [-0.5, width - 0.5).
  const double column = (pixel.x() + 0.5 - region_.x_px) / region_.width_px * config_.cells_x;
  const double row = (pixel.y() + 0.5 - region_.y_px) / region_.height_px * config_.cells_y;
  if (!(column >= 0 && row >= 0 && column < config_.cells_x && row < config_.cells_y)) return std::nullopt;
  return static_cast<int>(row) * config_.cells_x + static_cast<int>(column);
}

Eigen::Vector2d Coverage::cellCenter(int cell) const {
  const int column = cell % config_.cells_x, row = cell / config_.cells_x;
  return {region_.x_px + (column + 0.5) * region_.width_px / config_.cells_x - 0.5,
          region_.y_px + (row + 0.5) * region_.height_px / config_.cells_y - 0.5};
}

int Coverage::filledCells() const {
  int filled_cells = 0;
  for (int cell = 0; cell < cells(); ++cell) filled_cells += filled(cell);
  return filled_cells;
}

std::vector<int> Coverage::openCells() const {
  std::vector<int> open;
  for (int cell = 0; cell < cells(); ++cell) {
    if (!filled(cell) && !given_up_[cell] && !aside_[cell]) open.push_back(cell);
  }
  const Eigen::Vector2d center(region_.x_px + 0.5 * (region_.width_px - 1), region_.y_px + 0.5 * (region_.height_px - 1));
  std::stable_sort(open.begin(), open.end(), [&](int a, int b) {
    return (cellCenter(a) - center).norm() < (cellCenter(b) - center).norm();
  });
  return open;
}

bool Coverage::isFar(const Pose<Color, Board>& cMo) const {
  return cMo.translation().z() >= config_.distance_ratio * config_.near_distance_m;
}

int Coverage::deficit() const {
  int lacking = 0;
  if (!marginals_aside_) {
    lacking += std::max(0, near_goal_ - near_views_) + std::max(0, far_goal_ - far_views_);
    for (std::size_t i = 0; i < tilt_views_.size(); ++i)
      lacking += std::max(0, tilt_goals_[i] - tilt_views_[i]);
  }
  for (const int cell : openCells()) lacking += missingToFill(cell);
  return lacking;
}

int Coverage::missingCorners(const std::vector<Eigen::Vector2d>& pixels) const {
  std::vector<int> hits(cells(), 0);
  for (const Eigen::Vector2d& pixel : pixels) {
    if (const auto cell = cellAt(pixel)) ++hits[*cell];
  }
  int missing_corners = 0;
  for (int cell = 0; cell < cells(); ++cell) {
    if (given_up_[cell] || aside_[cell]) continue;
    missing_corners += std::min(hits[cell], missingToFill(cell));
  }
  return missing_corners;
}

int Coverage::missingMarginals(const Pose<Color, Board>& cMo) const {
  if (marginals_aside_) return 0;
  const bool distance = isFar(cMo) ? far_views_ < far_goal_ : near_views_ < near_goal_;
  const auto bin = static_cast<std::size_t>(tiltBinOf(cMo));
  const bool tilt = tilt_views_[bin] < tilt_goals_[bin];
  return int(distance) + int(tilt);
}

bool Coverage::complete() const { return missing().empty(); }

std::vector<std::string> Coverage::missing() const {
  std::vector<std::string> sentences;
  int aside = 0;
  for (int cell = 0; cell < cells(); ++cell) aside += aside_[cell] && !filled(cell) && !given_up_[cell];
  if (const int empty = static_cast<int>(openCells().size()) + aside; empty > 0) {
    sentences.push_back(std::to_string(empty) + " of " + std::to_string(cells()) +
                        " image cells are not filled");
    if (aside > 0) sentences.back() += ", " + std::to_string(aside) + kLostHalfSentence;
  }
  const auto require = [&](int have, int want, const std::string& what) {
    if (have < want) {
      sentences.push_back("only " + std::to_string(have) + " of " + std::to_string(want) + " " + what);
      if (marginals_aside_) sentences.back() += std::string(", the rest") + kLostHalfSentence;
    }
  };
  require(near_views_, near_goal_, "near views");
  require(far_views_, far_goal_, "far views");
  for (const TiltBin bin : kTiltBins) {
    const auto i = static_cast<std::size_t>(bin);
    require(tilt_views_[i], tilt_goals_[i], std::string("views with tilt ") + toString(bin));
  }
  return sentences;
}

CoverageSummary Coverage::summary() const {
  CoverageSummary summary;
  summary.cells_x = config_.cells_x;
  summary.cells_y = config_.cells_y;
  summary.corners_per_cell = corners_;
  summary.unreachable = given_up_;
  summary.corners_to_fill = config_.corners_per_cell;
  summary.near_views = near_views_;
  summary.far_views = far_views_;
  for (const TiltBin bin : kTiltBins) {
    summary.tilt_bins.emplace_back(toString(bin), tilt_views_[static_cast<std::size_t>(bin)]);
  }
  summary.out_of_reach = out_of_reach_;
  return summary;
}

}  // namespace servocal::coverage
