// SPDX-License-Identifier: GPL-3.0-or-later
#include "search.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/core/hal/intrin.hpp>

#include "lattice.h"
#include "saddle.h"
#include "whole_board.h"

namespace servocal::board {
namespace {

// Measures and checks one place where the board may lie.
std::optional<Found> examine(const cv::Mat& gray, const Checkerboard& board, double rim_squares,
                             const Lattice& lattice, double scale, const Placement& placement) {
  auto grid = measureGrid(gray, board, lattice, scale, placement);
  if (!grid || !isWholeBoard(gray, *grid, board, rim_squares)) return std::nullopt;
  Found found{std::move(*grid), {}};
  found.mark = findTurn(gray, found.grid, board);
  if (found.mark.status == MarkStatus::kImpossible) return std::nullopt;
  if (board.hollow_corner) {
    std::vector<Eigen::Vector2i> solid;
    for (int quarters = 0; quarters < 4; ++quarters) {
      const auto& turns = found.mark.turns;
      if (std::none_of(turns.begin(), turns.end(),
                       [&](const Turn& turn) { return turn.quarters == quarters; }))
        solid.push_back(Turn{quarters}.firstCorner());
    }
    remeasureBesideSolid(gray, solid, found.grid);
  }
  return found;
}

// Bounds the time spent on a texture: clutter has at most two thirds of them, and black on white has as much
// contrast as anything in its light.
std::vector<Saddle> clearest(std::vector<Saddle> saddles) {
  constexpr std::size_t kMostSaddles = 3000;
  if (saddles.size() <= kMostSaddles) return saddles;
  std::nth_element(saddles.begin(), saddles.begin() + kMostSaddles, saddles.end(),
                   [](const Saddle& a, const Saddle& b) { return a.contrast > b.contrast; });
  saddles.resize(kMostSaddles);
  return saddles;
}

}  // namespace

cv::Mat halve(const cv::Mat& gray) {
  cv::Mat half(gray.rows / 2, gray.cols / 2, CV_8UC1);
  for (int y = 0; y < half.rows; ++y) {
    const uchar* a = gray.ptr<uchar>(2 * y);
    const uchar* b = gray.ptr<uchar>(2 * y + 1);
    uchar* out = half.ptr<uchar>(y);
    int x = 0;
#if CV_SIMD128
    using namespace cv;
    const v_uint16x8 low = v_setall_u16(0xff);
    const auto pairs = [&](const uchar* row) {
      const v_uint16x8 both = v_reinterpret_as_u16(v_load(row));
      return (both & low) + (both >> 8);
    };
    const v_uint16x8 two = v_setall_u16(2);
    for (; x + 8 <= half.cols; x += 8)
      v_pack_store(out + x, (pairs(a + 2 * x) + pairs(b + 2 * x) + two) >> 2);
#endif
    for (; x < half.cols; ++x)
      out[x] = static_cast<uchar>((a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1] + 2) >> 2);
  }
  return half;
}

std::optional<Found> searchBoard(const cv::Mat& gray, const Checkerboard& board, double rim_squares,
                                 const std::vector<int>& levels) {
  struct Level {
    cv::Mat smoothed;
    std::vector<Saddle> saddles;
  };
  std::vector<cv::Mat> pyramid{gray};
  std::map<int, Level> seen;
  // Fine textures imitate boards of a few pixels per square: such a one is taken only if there is no larger
  // one.
  constexpr double kSureSpacingPx = 6.0;
  // Squares larger than this are seen well enough a level coarser, if that was searched: the straight lines
  // of tiles and buildings need not be followed across the whole image again.
  constexpr float kLongestAgainPx = 44.0f;
  std::optional<Found> best;
  const int min_nodes = std::max(4, board.cornerCount() * 7 / 10);
  for (const auto& find : {findLattices, growLattices}) {
    for (const int level : levels) {
      while (static_cast<int>(pyramid.size()) <= level) pyramid.push_back(halve(pyramid.back()));
      const cv::Mat& image = pyramid[level];
      if (image.cols < 24 || image.rows < 24) continue;
      Level& here = seen[level];
      if (here.smoothed.empty()) {
        here.smoothed = smooth(image);
        here.saddles = clearest(withoutTwins(image.size(), findSaddles(here.smoothed)));
      }
      const double scale = 1 << level;
      const bool is_coarser_done = seen.count(level + 1) > 0;
      const float longest_px = is_coarser_done ? kLongestAgainPx : std::hypot(image.cols, image.rows);
      for (const Lattice& lattice : find(here.smoothed, here.saddles, min_nodes, longest_px)) {
        for (const Placement& placement : findPlacements(lattice, board)) {
          auto found = examine(gray, board, rim_squares, lattice, scale, placement);
          if (!found) continue;
          // A board that shows its mark is preferred to one that does not.
          if (board.hollow_corner && found->mark.status == MarkStatus::kFound) return found;
          if (!best || found->grid.smallestSpacing() > best->grid.smallestSpacing()) best = std::move(found);
        }
      }
      if (best && best->grid.smallestSpacing() >= kSureSpacingPx) return best;
    }
  }
  return best;
}

}  // namespace servocal::board
