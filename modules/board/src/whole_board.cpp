// SPDX-License-Identifier: GPL-3.0-or-later
#include "whole_board.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "median.h"
#include "sample.h"

namespace servocal::board {
namespace {

using Eigen::Vector2d;

// Mean brightness around a point, or nothing if outside the image.
std::optional<double> brightness(const cv::Mat& gray, const Vector2d& pixel, int radius) {
  if (!pixel.allFinite() || (pixel.array().abs() > 1e6).any()) return std::nullopt;
  const int x = static_cast<int>(std::lround(pixel.x()));
  const int y = static_cast<int>(std::lround(pixel.y()));
  if (x < radius || y < radius || x + radius >= gray.cols || y + radius >= gray.rows) return std::nullopt;
  int sum = 0;
  for (int dy = -radius; dy <= radius; ++dy) {
    const uchar* row = gray.ptr<uchar>(y + dy);
    for (int dx = -radius; dx <= radius; ++dx) sum += row[x + dx];
  }
  const int side = 2 * radius + 1;
  return static_cast<double>(sum) / (side * side);
}

// Mean brightness of the square that lies from a corner towards (du, dv), in signs, near that corner.
std::optional<double> quadrant(const cv::Mat& gray, const Vector2d& corner, const Eigen::Matrix2d& axes,
                               int du, int dv) {
  double sum = 0.0;
  for (const auto& [u, v] : {std::pair(0.25, 0.5), std::pair(0.4, 0.4), std::pair(0.5, 0.25)}) {
    const auto value = brightnessAt(gray, corner + axes * Vector2d(du * u, dv * v));
    if (!value) return std::nullopt;
    sum += *value / 3.0;
  }
  return sum;
}

double medianResidual(const Grid& grid) {
  std::vector<double> residuals;
  for (const CornerFit& corner : grid.corners) residuals.push_back(corner.residual);
  return median(residuals);
}

// True if squares meet in the measured corners, two bright and two dark, all along every line of the grid.
// The outline of a smaller board has corners of one dark square; what covers a board has none. A few may be
// hidden. Where the hollow square may be, three squares have to do.
bool showsCorners(const cv::Mat& gray, const Grid& grid, const Checkerboard& board) {
  const int count = grid.columns * grid.rows;
  std::vector<double> steps(count), gaps(count);
  for (int k = 0; k < count; ++k) {
    const int column = k % grid.columns, row = k / grid.columns;
    const Eigen::Matrix2d axes = grid.warp.jacobian({column, row});
    const auto outwards = [](int place, int length) { return place == 0 ? -1 : place == length - 1 ? 1 : 0; };
    const Eigen::Vector2i out(outwards(column, grid.columns), outwards(row, grid.rows));
    const double sign = grid.corners[k].step > 0 ? 1.0 : -1.0;
    double bright = 1e9, dark = -1e9, bright_sum = 0.0, dark_sum = 0.0;
    int bright_count = 0, dark_count = 0;
    for (const int du : {-1, 1}) {
      for (const int dv : {-1, 1}) {
        if (board.hollow_corner && out.x() == du && out.y() == dv) continue;
        const auto value = quadrant(gray, grid.corners[k].pixel, axes, du, dv);
        if (!value) return false;
        if (du * dv * sign > 0) {
          bright = std::min(bright, *value);
          bright_sum += *value;
          ++bright_count;
        } else {
          dark = std::max(dark, *value);
          dark_sum += *value;
          ++dark_count;
        }
      }
    }
    steps[k] = 0.5 * (bright_sum / bright_count - dark_sum / dark_count);
    gaps[k] = bright - dark;
  }
  const double typical = median(steps);
  if (typical <= 0.0) return false;
  const double noise = medianResidual(grid);
  const auto hides = [&](int column, int row) {
    const int k = row * grid.columns + column;
    // Something narrow over the corner leaves the squares as they are, but not the fit.
    const double residual = grid.corners[k].residual;
    return steps[k] < 0.4 * typical || gaps[k] < 0.3 * std::max(steps[k], typical) ||
           (residual > 2.5 * noise && residual > 0.15 * grid.step);
  };
  int hidden = 0;
  const auto lineShows = [&](int column, int row, int du, int dv, int length) {
    int here = 0;
    double squares = 0.0;
    for (int k = 0; k < length; ++k, column += du, row += dv) {
      here += hides(column, row);
      squares += std::pow(grid.at(column, row).residual, 2);
    }
    hidden += here;
    const double residual = std::sqrt(squares / length);
    return 2 * here < length && (residual < 1.8 * noise || residual < 0.12 * grid.step);
  };
  for (int row = 0; row < grid.rows; ++row)
    if (!lineShows(0, row, 1, 0, grid.columns)) return false;
  for (int column = 0; column < grid.columns; ++column)
    if (!lineShows(column, 0, 0, 1, grid.rows)) return false;
  return 3 * hidden <= count;  // Counted twice, by row and by column.
}

// True if no line's edges rise over a longer way than those of the lines beside it: focus changes slowly over the
// board, but a strip over a line of corners, however thin and whatever its gray, makes one edge into two.
bool edgesAreAlike(const Grid& grid) {
  constexpr double kMost = 1.3;  // Rendered boards reach 1.1.
  constexpr double kFinestPx = 0.5;  // Below a pixel, sampling and sharpening say more about a rise than blur does.
  // With more blur than this a line of edges is a sine wave, whose height and rise are one and the same.
  constexpr double kSineBlur = 0.2;  // squares
  const bool is_sine = grid.blur_px.maxCoeff() > kSineBlur * grid.smallestSpacing();
  const auto isAlike = [&](int lines, int length, const auto& blurAt, const auto& stepAt) {
    std::vector<double> blurs, steps;
    for (int k = 0; k < lines; ++k) {
      std::vector<double> blur, step;
      for (int place = 0; place < length; ++place) {
        blur.push_back(blurAt(k, place));
        step.push_back(std::abs(stepAt(k, place)));
      }
      blurs.push_back(median(blur));
      steps.push_back(median(step));
    }
    for (int k = 0; k < lines; ++k) {
      // At the ends, as wide as the next line's or as the trend of the next two goes on.
      const int one = k > 0 ? k - 1 : k + 1, other = k < lines - 1 ? k + 1 : k - 1;
      const int next = k == 0 ? 2 : lines - 3;
      const double expected = one == other ? std::max(blurs[one], 2 * blurs[one] - blurs[next])
                                           : 0.5 * (blurs[one] + blurs[other]);
      double rise = (blurs[k] + kFinestPx) / (expected + kFinestPx);
      const double beside = 0.5 * (steps[k > 0 ? k - 1 : k + 1] + steps[k < lines - 1 ? k + 1 : k - 1]);
      if (is_sine) rise *= std::max(beside / steps[k], 1.0);
      if (rise > kMost) return false;
    }
    return true;
  };
  return isAlike(grid.rows, grid.columns, [&](int k, int place) { return grid.at(place, k).blur_px.x(); },
                 [&](int k, int place) { return grid.at(place, k).step; }) &&
         isAlike(grid.columns, grid.rows, [&](int k, int place) { return grid.at(k, place).blur_px.y(); },
                 [&](int k, int place) { return grid.at(k, place).step; });
}

// True if it looks as if dots were taken for squares: between the dots of a perforated sheet, whose rows cross like
// squares set on edge. However blurred, a checkerboard is black and white in equal parts, so that a corner is as
// bright as the mean of its squares (unless the camera's response is curved), and as bright as the middle of an
// edge (always). Between dots it is neither. Says nothing of large squares, where nobody takes dots for them.
bool showsDots(const cv::Mat& gray, const Grid& grid) {
  constexpr double kLargeSpacingPx = 12.0;
  const double spacing_px = grid.smallestSpacing();
  if (spacing_px > kLargeSpacingPx) return false;
  // Shares of white minus black. Rendered boards reach 0.05 in both, dots start at 0.18 and 0.06, at 0.17 from 6 px on,
  // where blur leaves more of their shape; a real board whose white has bloomed shows 0.24 and 0.09 at 7 px.
  constexpr double kMostOffSquares = 0.12;
  const double most_off_edges = std::clamp(0.05 * (spacing_px - 3.0), 0.05, 0.15);
  double off_squares = 0.0, off_edges = 0.0, contrast = 0.0;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const bool at_end = (column == 0 || column == grid.columns - 1) && (row == 0 || row == grid.rows - 1);
      if (at_end) continue;  // A hollow square may be there.
      bool seen = true;
      const auto at = [&](double du, double dv) {
        const auto value = brightnessAt(gray, grid.warp.at(Vector2d(column + du, row + dv)));
        seen = seen && value.has_value();
        return value.value_or(0.0);
      };
      const double first = 0.5 * (at(-0.5, -0.5) + at(0.5, 0.5)), second = 0.5 * (at(-0.5, 0.5) + at(0.5, -0.5));
      const double edges = 0.25 * (at(-0.5, 0) + at(0.5, 0) + at(0, -0.5) + at(0, 0.5));
      const double corner = at(0, 0);
      if (!seen) continue;
      off_squares += corner - 0.5 * (first + second);
      off_edges += corner - edges;
      contrast += std::abs(first - second);
    }
  }
  return std::abs(off_squares) > kMostOffSquares * contrast && std::abs(off_edges) > most_off_edges * contrast;
}

}  // namespace

bool isWholeBoard(const cv::Mat& gray, const Grid& grid, const Checkerboard& board, double rim_squares) {
  if (!showsCorners(gray, grid, board) || !edgesAreAlike(grid) || showsDots(gray, grid)) return false;
  const int radius = std::clamp(static_cast<int>(0.1 * grid.smallestSpacing()), 0, 3);
  // Cells are numbered from -1 (outside the first corner) to columns - 1; even sums share a color.
  const auto cellIsWhite = [&](int column, int row) {
    const bool first_is_white = grid.at(0, 0).step > 0;  // The cell (-1,-1), as is the cell (0,0).
    return ((column + row) % 2 == 0) == first_is_white;
  };
  const auto cell = [&](double column, double row) {
    return brightness(gray, grid.warp.at({column + 0.5, row + 0.5}), radius);
  };

  // Colors of the inner cells.
  int right = 0, wrong = 0;
  for (int row = 0; row < grid.rows - 1; ++row) {
    for (int column = 0; column < grid.columns - 1; ++column) {
      const auto value = cell(column, row);
      const CornerFit& corner = grid.at(column, row);
      if (!value) return false;
      // Compared with the opposite color diagonally across the nearest edge.
      const auto beside = cell(column + 1 < grid.columns - 1 ? column + 1 : column - 1, row);
      if (!beside) return false;
      const double difference = cellIsWhite(column, row) ? *value - *beside : *beside - *value;
      (difference > 0.5 * std::abs(corner.step) ? right : wrong)++;
    }
  }
  if (wrong * 10 > right) return false;

  // One sample beyond each cell of a side, `beyond` squares from the last corners; 1 is white, 0 black.
  struct Side {
    bool along_u, first;
  };
  const auto rim = [&](const Side& side, double beyond, bool white_cells_only) {
    const int length = side.along_u ? grid.columns : grid.rows;
    const int line = side.first ? -1 : (side.along_u ? grid.rows : grid.columns) - 1;
    const int inward = side.first ? line + 1 : line - 1;
    const double outside = side.first ? line + 0.5 - beyond : line - 0.5 + beyond;
    std::pair<int, int> white_of_all(0, 0);
    for (int k = -1; k < length; ++k) {
      const bool is_white = side.along_u ? cellIsWhite(k, line) : cellIsWhite(line, k);
      if (white_cells_only && !is_white) continue;
      const auto value = side.along_u ? cell(k, outside) : cell(outside, k);
      if (!value) continue;
      if (white_cells_only) {
        // Compared with the white cell itself: a light that falls on a part of the board only is much the
        // same there.
        const auto itself = side.along_u ? cell(k, line) : cell(line, k);
        if (!itself) continue;
        ++white_of_all.second;
        if (*value > *itself - 0.8 * grid.step) ++white_of_all.first;
        continue;
      }
      // References: two cells one line further in, which are never hollow. Past the ends, the last ones.
      const int here = std::clamp(k, 0, length - 2);
      const int beside = here > 0 ? here - 1 : here + 1;
      const auto one = side.along_u ? cell(here, inward) : cell(inward, here);
      const auto other = side.along_u ? cell(beside, inward) : cell(inward, beside);
      if (!one || !other) continue;
      const double white = std::max(*one, *other), black = std::min(*one, *other);
      ++white_of_all.second;
      if (*value - black > 0.6 * (white - black)) ++white_of_all.first;
    }
    return white_of_all;
  };
  // Half a step between the squares around a corner, and the gap between the two pairs.
  struct Look {
    double step, gap;
  };
  const auto look = [&](const Vector2d& at) -> std::optional<Look> {
    const Eigen::Matrix2d axes = grid.warp.jacobian(at);
    const Vector2d pixel = grid.warp.at(at);
    const int sign = (std::lround(at.x() + at.y()) % 2 == 0) == (grid.at(0, 0).step > 0) ? 1 : -1;
    std::array<double, 4> value;
    int next = 0;
    for (const int du : {-1, 1}) {
      for (const int dv : {-1, 1}) {
        const auto mean = quadrant(gray, pixel, axes, du, dv);
        if (!mean) return std::nullopt;
        value[next++] = sign * *mean;
      }
    }
    return Look{0.25 * (value[0] + value[3] - value[1] - value[2]),
                std::min(value[0], value[3]) - std::max(value[1], value[2])};
  };
  double inner_step = 0.0;  // As seen by the same measure inside.
  {
    std::vector<double> steps;
    for (int row = 0; row < grid.rows; ++row)
      for (int column = 0; column < grid.columns; ++column)
        if (const auto inner = look({column, row})) steps.push_back(inner->step);
    if (steps.empty()) return false;
    inner_step = median(steps);
  }
  // Corners that follow one square beyond a side, and places there that are none. The outer corner of a last
  // black square gives half a step and no gap.
  const auto following = [&](const Side& side) {
    const int corners = side.along_u ? grid.columns : grid.rows;
    const int line = side.first ? -1 : side.along_u ? grid.rows : grid.columns;
    std::pair<int, int> next_and_none(0, 0);
    for (int k = 0; k < corners; ++k) {
      const auto beyond = look(side.along_u ? Vector2d(k, line) : Vector2d(line, k));
      if (!beyond) continue;
      (beyond->step > 0.75 * inner_step && beyond->gap > inner_step ? next_and_none.first
                                                                    : next_and_none.second)++;
    }
    return next_and_none;
  };
  // A larger board would go on black beyond the white cells; and no line beside the board would be white
  // all along, as the rim is, wherever it starts (some boards have narrower outer squares). Things behind a
  // narrow rim look like a corner now and then; if many do, the rim must be there to prove the end.
  const auto endsOnSide = [&](const Side& side) {
    const auto [next, none] = following(side);
    // The pattern goes on. Halfway between two lines of squares it may still be bright all along, in a light that
    // grows that way.
    if (next >= 3 && 4 * next >= 3 * (next + none)) return false;
    const bool by_chance = next < 2 || 4 * next <= next + none;
    const double one = 1.0 + std::min(0.25, 0.5 * rim_squares);
    const auto [white, all] = rim(side, one, true);
    if (by_chance && white > 0 && 2 * white >= all) return true;
    for (double beyond = 0.4; beyond < 1.3; beyond += 0.06) {
      const auto [white_here, all_here] = rim(side, beyond, false);
      if (all_here >= 3 && 10 * white_here > (by_chance ? 7 : 8) * all_here) return true;
    }
    if (!by_chance) return false;
    // A mark needs its printed rim; boards without one are also accepted where clearly no corner follows.
    if (board.hollow_corner) return false;
    const int corners = side.along_u ? grid.columns : grid.rows;
    return 2 * (next + none) >= corners && 10 * none >= 7 * (next + none);
  };
  return endsOnSide({true, true}) && endsOnSide({true, false}) && endsOnSide({false, true}) &&
         endsOnSide({false, false});
}

}  // namespace servocal::board
