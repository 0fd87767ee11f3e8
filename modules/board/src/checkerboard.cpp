// SPDX-License-Identifier: GPL-3.0-or-later
#include "finder.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "search.h"

namespace servocal::board {
namespace {

using Eigen::Vector2d;

constexpr double kCovarianceFloorPx = 0.005;  // Below this, print and lens decide, not noise.

// From large squares to small where that is cheaper: most boards in large images have large squares.
std::vector<int> levelsFor(const cv::Size& size) {
  const double pixels = static_cast<double>(size.width) * size.height;
  if (pixels > 4e6) return {2, 1, 0, 3};
  if (pixels > 8e5) return {1, 0, 2};
  return {0, 1, 2};
}

std::vector<Corner> cornersOf(const Grid& grid, const Turn& turn, const Checkerboard& board, const Vector2d& offset) {
  std::vector<double> residuals;
  for (const CornerFit& fit : grid.corners) residuals.push_back(fit.residual);
  std::nth_element(residuals.begin(), residuals.begin() + residuals.size() / 2, residuals.end());
  const double typical = residuals[residuals.size() / 2];

  std::vector<Corner> corners;
  for (int id = 0; id < board.cornerCount(); ++id) {
    const Eigen::Vector2i place =
        turn.corner(id % board.cornersX(), id / board.cornersX(), grid.columns, grid.rows);
    const CornerFit& fit = grid.at(place.x(), place.y());
    Corner corner;
    corner.id = id;
    corner.pixel = fit.pixel + offset;
    const double noise_squared = std::max(0.5 * (typical * typical + fit.residual * fit.residual), 0.1);
    corner.covariance_px2 = noise_squared * fit.structure.inverse() +
                            kCovarianceFloorPx * kCovarianceFloorPx * Eigen::Matrix2d::Identity();
    corners.push_back(corner);
  }
  return corners;
}

double meanDistance(const std::vector<Corner>& a, const std::vector<Corner>& b, const Vector2d& shift) {
  double sum = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += (a[k].pixel + shift - b[k].pixel).norm();
  return sum / a.size();
}

class CheckerboardFinder final : public Finder {
 public:
  explicit CheckerboardFinder(const BoardSpec& spec)
      : board(*spec.as<Checkerboard>()), rim_squares(spec.margin_m / board.square_size_m) {
    if (board.squares_x < 3 || board.squares_y < 3)
      throw std::invalid_argument("Detector: the board needs at least 3 x 3 squares");
    if (board.hollow_corner && (board.squares_x % 2 == 0 || board.squares_y % 2 == 0))
      throw std::invalid_argument("Detector: a hollow corner needs an odd number of squares each way");
  }

  std::optional<BoardDetection> detect(const cv::Mat& image) override;
  std::optional<BoardDetection> track(const cv::Mat& image) override;
  void reset() override {
    last.clear();
    velocity.setZero();
  }

 private:
  Checkerboard board;
  double rim_squares;
  std::vector<Corner> last;           // Empty: nothing to track.
  Vector2d velocity = Vector2d::Zero();  // Of the board's centre, px per frame.
  double spacing_px = 0.0;            // Smallest, at the last detection.

  BoardDetection accept(const Found& found, const Vector2d& offset, bool tracking) {
    BoardDetection detection;
    detection.orientation_known = found.mark.status == MarkStatus::kFound;
    // Undecided: the turn that continues the track, or else the one whose corner 0 is nearest the upper
    // left of the image.
    double best = 0.0;
    for (const Turn& turn : found.mark.turns) {
      std::vector<Corner> corners = cornersOf(found.grid, turn, board, offset);
      const Vector2d first = corners.front().pixel;
      const double cost = tracking && !last.empty() ? meanDistance(last, corners, velocity)
                                                    : first.x() + 1.001 * first.y();
      if (!detection.corners.empty() && cost >= best) continue;
      best = cost;
      detection.corners = std::move(corners);
    }
    const Vector2d centre = centreOf(detection.corners);
    velocity = tracking && !last.empty() ? Vector2d(centre - centreOf(last)) : Vector2d(Vector2d::Zero());
    last = detection.corners;
    spacing_px = found.grid.smallestSpacing();
    return detection;
  }

  static Vector2d centreOf(const std::vector<Corner>& corners) {
    Vector2d sum = Vector2d::Zero();
    for (const Corner& corner : corners) sum += corner.pixel;
    return sum / static_cast<double>(corners.size());
  }
};

std::optional<BoardDetection> CheckerboardFinder::detect(const cv::Mat& image) {
  const cv::Mat gray = toGray(image);
  const auto found = searchBoard(gray, board, rim_squares, levelsFor(gray.size()));
  if (!found) {
    reset();
    return std::nullopt;
  }
  return accept(*found, Vector2d::Zero(), false);
}

std::optional<BoardDetection> CheckerboardFinder::track(const cv::Mat& image) {
  if (last.empty()) return std::nullopt;
  Vector2d low = last.front().pixel;
  Vector2d high = low;
  double longest = 0.0;
  for (const Corner& corner : last) {
    low = low.cwiseMin(corner.pixel);
    high = high.cwiseMax(corner.pixel);
    if (corner.id % board.cornersX() > 0)
      longest = std::max(longest, (corner.pixel - last[corner.id - 1].pixel).norm());
    if (corner.id >= board.cornersX())
      longest = std::max(longest,
                         (corner.pixel - last[corner.id - board.cornersX()].pixel).norm());
  }
  // The outer squares, the rim, and as far as the board may have moved.
  constexpr double kMotionPx = 40.0;
  const double margin = 1.4 * longest + kMotionPx;
  low += velocity.cwiseMin(0.0) - Vector2d::Constant(margin);
  high += velocity.cwiseMax(0.0) + Vector2d::Constant(margin);
  const int x0 = std::max(0, static_cast<int>(low.x())) & ~3;
  const int y0 = std::max(0, static_cast<int>(low.y())) & ~3;
  const int x1 = std::min(image.cols, static_cast<int>(high.x()) + 1);
  const int y1 = std::min(image.rows, static_cast<int>(high.y()) + 1);
  if (x1 - x0 < 24 || y1 - y0 < 24) return std::nullopt;
  const cv::Mat gray = toGray(image(cv::Rect(x0, y0, x1 - x0, y1 - y0)));

  // The coarsest level that still shows the squares well, then its neighbors.
  constexpr double kGoodSpacingPx = 8.0;
  int level = 0;
  while (level < 3 && spacing_px / (2 << level) >= kGoodSpacingPx) ++level;
  std::vector<int> levels{level};
  if (level > 0) levels.push_back(level - 1);
  levels.push_back(level + 1);
  const auto found = searchBoard(gray, board, rim_squares, levels);
  if (!found) return std::nullopt;
  return accept(*found, Vector2d(x0, y0), true);
}

}  // namespace

std::unique_ptr<Finder> makeCheckerboardFinder(const BoardSpec& board) {
  return std::make_unique<CheckerboardFinder>(board);
}

}  // namespace servocal::board
