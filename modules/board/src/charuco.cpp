// SPDX-License-Identifier: GPL-3.0-or-later
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <stdexcept>

#include "corner_fit.h"
#include "finder.h"
#include "median.h"
#include "tag_family.h"
#include "tag_search.h"

namespace servocal::board {
namespace {

using Eigen::Vector2d;

constexpr double kCovarianceFloorPx = 0.005;  // Below this, print and lens decide, not noise.

// In squares from corner 0, one square right and down of the board's upper left.
std::vector<BoardTag> markersOf(const Charuco& board) {
  std::vector<BoardTag> markers;
  const double inset = 0.5 * (1.0 - board.marker_size_m / board.square_size_m);
  for (int row = 0; row < board.squares_y; ++row) {
    for (int column = 0; column < board.squares_x; ++column) {
      if (((row + column) % 2 == 0) != board.first_square_white) continue;
      BoardTag marker;
      marker.code = static_cast<int>(markers.size());
      const Vector2d low = Vector2d(column - 1 + inset, row - 1 + inset);
      const double side = 1.0 - 2.0 * inset;
      marker.on_board = {low, low + Vector2d(side, 0), low + Vector2d(side, side), low + Vector2d(0, side)};
      marker.cells = tagCells(board.dictionary, marker.code, 1);
      markers.push_back(marker);
    }
  }
  return markers;
}

class CharucoFinder final : public Finder {
 public:
  explicit CharucoFinder(const Charuco& board)
      : board_(board), search_(makeArucoReader(board.dictionary, 1), 1, markersOf(board)) {}

  std::optional<BoardDetection> detect(const cv::Mat& image) override {
    return detectionOf(toGray(image), search_.detect(image));
  }
  std::optional<BoardDetection> track(const cv::Mat& image) override {
    return detectionOf(image, search_.track(image));
  }
  void reset() override { search_.reset(); }

 private:
  Charuco board_;
  TagSearch search_;

  struct Measured {
    int id;
    CornerGuess guess;
    CornerFit fit;
  };

  std::optional<BoardDetection> detectionOf(const cv::Mat& image,
                                            const std::vector<PlacedTag>& markers) const {
    if (markers.empty()) return std::nullopt;
    const cv::Mat gray = toGray(image);
    std::vector<Measured> corners = firstLook(gray, markers);
    if (corners.size() < 4) return std::nullopt;
    measure(gray, corners);
    if (corners.size() < 4) return std::nullopt;
    std::vector<double> residuals;
    for (const Measured& corner : corners) residuals.push_back(corner.fit.residual);
    const double typical = median(residuals);
    BoardDetection detection;
    detection.orientation_known = true;
    for (const Measured& corner : corners) {
      const double residual = corner.fit.residual;
      const double noise_squared = std::max(0.5 * (typical * typical + residual * residual), 0.1);
      detection.corners.push_back(
          {corner.id, corner.fit.pixel,
           noise_squared * corner.fit.structure.inverse() +
               kCovarianceFloorPx * kCovarianceFloorPx * Eigen::Matrix2d::Identity()});
    }
    return detection;
  }

  /// Corners with a marker beside them, which tells where they are to a fraction of a square.
  std::vector<Measured> firstLook(const cv::Mat& gray, const std::vector<PlacedTag>& markers) const {
    constexpr double kBeside = 0.8;  // squares from a marker's centre; its squares' corners are 0.71 away.
    const double hollow_start = 0.5 * (1.0 - board_.marker_size_m / board_.square_size_m);
    std::vector<Measured> corners;
    const int columns = board_.squares_x - 1, rows = board_.squares_y - 1;
    for (int id = 0; id < columns * rows; ++id) {
      const Vector2d at(id % columns, id / columns);
      const auto isBeside = [&](const PlacedTag& m) { return (centreOf(m.on_board) - at).norm() < kBeside; };
      if (std::none_of(markers.begin(), markers.end(), isBeside)) continue;
      const Eigen::Matrix3d homography = localHomography(markers, at, 4);
      const auto project = [&](const Vector2d& p) {
        return Vector2d((homography * p.homogeneous()).hnormalized());
      };
      constexpr double kStep = 0.1;
      Measured corner;
      corner.id = id;
      corner.guess.pixel = project(at);
      for (int axis = 0; axis < 2; ++axis) {
        const Vector2d step = kStep * Vector2d::Unit(axis);
        corner.guess.axes.col(axis) = (project(at + step) - project(at - step)) / (2 * kStep);
      }
      // The square right and below of a corner is white where its column and row add up to odd, if the
      // first is black; markers are in the two white quadrants.
      const bool white = ((id % columns + id / columns) % 2 == 0) == board_.first_square_white;
      corner.guess.hollow_quadrant = {1, white ? 1 : -1};
      corner.guess.hollow_start = hollow_start;
      corner.guess.hollow_opposite = true;
      const double apart = std::abs(corner.guess.axes.determinant()) /
                           std::max(corner.guess.axes.col(0).norm(), corner.guess.axes.col(1).norm());
      corner.guess.blur_px.setConstant(std::clamp(0.1 * apart, 0.6, 1.2));
      const auto fit = fitCorner(gray, corner.guess);
      if (!fit || (fit->step > 0) != white) continue;
      corner.fit = *fit;
      corners.push_back(corner);
    }
    return corners;
  }

  /// Once more with the blur of all, which leaves only the position to each corner.
  static void measure(const cv::Mat& gray, std::vector<Measured>& corners) {
    std::vector<double> blur_u, blur_v, steps;
    for (const Measured& corner : corners) {
      blur_u.push_back(corner.fit.blur_px.x());
      blur_v.push_back(corner.fit.blur_px.y());
      steps.push_back(std::abs(corner.fit.step));
    }
    const Vector2d blur(median(blur_u), median(blur_v));
    const double step = median(steps);
    std::vector<Measured> kept;
    for (Measured& corner : corners) {
      corner.guess.pixel = corner.fit.pixel;
      corner.guess.blur_px = blur;
      corner.guess.fit_blur = false;
      const auto fit = fitCorner(gray, corner.guess);
      // Much fainter than the others: something is in front of it.
      if (!fit || fit->step * corner.fit.step < 0 || std::abs(fit->step) < 0.3 * step) continue;
      corner.fit = *fit;
      kept.push_back(corner);
    }
    corners = std::move(kept);
  }
};

}  // namespace

std::unique_ptr<Finder> makeCharucoFinder(const BoardSpec& board) {
  const Charuco& charuco = *board.as<Charuco>();
  if (charuco.squares_x < 3 || charuco.squares_y < 3)
    throw std::invalid_argument("Detector: the board needs at least 3 x 3 squares");
  return std::make_unique<CharucoFinder>(charuco);
}

}  // namespace servocal::board
