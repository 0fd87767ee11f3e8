// SPDX-License-Identifier: GPL-3.0-or-later
#include "grid.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "median.h"

namespace servocal::board {
namespace {

using Eigen::Vector2d;

Warp fitWarp(int columns, int rows, const std::vector<CornerFit>& corners) {
  std::vector<Vector2d> grid, pixels;
  for (int k = 0; k < columns * rows; ++k) {
    grid.emplace_back(k % columns, k / columns);
    pixels.push_back(corners[k].pixel);
  }
  return Warp(columns, rows, grid, pixels);
}

// Saddles beside the board may have taken a corner's place: drops the worst until the rest agree.
Warp fitWithoutStrays(int columns, int rows, std::vector<Vector2d>& grid, std::vector<Vector2d>& pixels) {
  const std::size_t fewest = std::max<std::size_t>(4, columns * rows * 7 / 10);
  while (true) {
    Warp warp(columns, rows, grid, pixels);
    std::size_t worst = 0;
    double largest = 0.0;
    for (std::size_t k = 0; k < grid.size(); ++k) {
      const Eigen::Matrix2d axes = warp.jacobian(grid[k]);
      const double side = std::max(axes.col(0).norm(), axes.col(1).norm());
      const double error = (warp.at(grid[k]) - pixels[k]).norm() / (1.5 + 0.1 * side);
      if (error > largest) {
        largest = error;
        worst = k;
      }
    }
    if (!(largest > 1.0) || grid.size() <= fewest) return warp;
    grid.erase(grid.begin() + worst);
    pixels.erase(pixels.begin() + worst);
  }
}

// Distances between edges along u and along v at a grid point, px.
Vector2d spacing(const Eigen::Matrix2d& axes) {
  const double area = std::abs(axes.determinant());
  return {area / axes.col(0).norm(), area / axes.col(1).norm()};
}

// At the grid's four corners, where the hollow square may be: keeps its white inside out of the window.
void avoidHollow(const Checkerboard& board, int columns, int rows, const Vector2d& at, CornerGuess& guess) {
  if (!board.hollow_corner) return;
  const auto outwards = [](double place, int count) {
    return place < 0.5 ? -1 : place > count - 1.5 ? 1 : 0;
  };
  const Eigen::Vector2i quadrant(outwards(at.x(), columns), outwards(at.y(), rows));
  if (quadrant.x() == 0 || quadrant.y() == 0) return;
  guess.hollow_quadrant = quadrant;
  guess.hollow_start = 0.5 * (1.0 - board.hollow_inner_ratio);
}

// True if no corner is off the smooth surface through all of them.
bool isSmooth(const Grid& grid) {
  double largest = 0.0, cell = 0.0;
  for (int k = 0; k < grid.columns * grid.rows; ++k) {
    const Vector2d at(k % grid.columns, k / grid.columns);
    const Eigen::Matrix2d axes = grid.warp.jacobian(at);
    if (axes.determinant() <= 0.0) return false;
    const CornerFit& corner = grid.corners[k];
    const double error = (grid.warp.at(at) - corner.pixel).norm();
    const double side = std::max(axes.col(0).norm(), axes.col(1).norm());
    // What noise may do to a corner of small or faint squares is no roughness.
    const double sigma = std::min(corner.residual * std::sqrt(corner.structure.inverse().trace()),
                                  0.1 * spacing(axes).minCoeff());
    if (error > std::hypot(0.6 + 0.04 * side, 3.0 * sigma)) return false;
    largest = std::max(largest, error);
    cell = std::max(cell, side);
  }
  return grid.warp.largestBend() < 0.6 * cell;
}

// True if neighboring corners show about the same brightness step: light and shadow change it slowly, the
// end of some other regular pattern abruptly.
bool isEven(const Grid& grid) {
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      double sum = 0.0;
      int count = 0;
      const auto add = [&](int c, int r) {
        if (c < 0 || r < 0 || c >= grid.columns || r >= grid.rows) return;
        sum += std::abs(grid.at(c, r).step);
        ++count;
      };
      add(column - 1, row);
      add(column + 1, row);
      add(column, row - 1);
      add(column, row + 1);
      const CornerFit& corner = grid.at(column, row);
      const double ratio = std::abs(corner.step) * count / sum;
      // The grid's four corners may have been measured in a part of their window only.
      const bool is_end = (column == 0 || column == grid.columns - 1) && (row == 0 || row == grid.rows - 1);
      const double least = is_end ? 0.4 : 0.6;
      if (ratio < least || ratio > 1.7 || corner.residual > 0.6 * std::abs(corner.step)) return false;
    }
  }
  return true;
}

// True if one row or column of corners is fainter than the others and does not look like corners as they do: a strip
// over it that leaves edges beside it, blurred into something like corners.
bool hasCoveredLine(const Grid& grid) {
  constexpr double kFainter = 0.75, kRougher = 1.4;
  std::vector<double> steps, residuals;
  const auto take = [&](int column, int row) {
    steps.push_back(std::abs(grid.at(column, row).step));
    residuals.push_back(grid.at(column, row).residual);
  };
  for (int row = 0; row < grid.rows; ++row)
    for (int column = 0; column < grid.columns; ++column) take(column, row);
  const double step = median(steps), residual = median(residuals);
  const auto isCovered = [&] { return median(steps) < kFainter * step && median(residuals) > kRougher * residual; };
  for (int row = 0; row < grid.rows; ++row) {
    steps.clear(), residuals.clear();
    for (int column = 0; column < grid.columns; ++column) take(column, row);
    if (isCovered()) return true;
  }
  for (int column = 0; column < grid.columns; ++column) {
    steps.clear(), residuals.clear();
    for (int row = 0; row < grid.rows; ++row) take(column, row);
    if (isCovered()) return true;
  }
  return false;
}

}  // namespace

double Grid::smallestSpacing() const {
  double smallest = 1e9;
  for (const double u : {0.0, columns - 1.0})
    for (const double v : {0.0, rows - 1.0})
      smallest = std::min(smallest, spacing(warp.jacobian({u, v})).minCoeff());
  return smallest;
}

std::optional<Grid> measureGrid(const cv::Mat& gray, const Checkerboard& board, const Lattice& lattice,
                                double scale, const Placement& placement) {
  const int columns = placement.columns;
  const int rows = placement.rows;
  std::vector<Vector2d> known, pixels;
  int side = 0;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const auto it = lattice.nodes.find({placement.i0 + column, placement.j0 + row});
      if (it == lattice.nodes.end()) continue;
      known.emplace_back(column, row);
      pixels.push_back(((it->second.pixel.cast<double>().array() + 0.5) * scale - 0.5).matrix());
      side = (column + row) % 2 == 0 ? it->second.side : -it->second.side;
    }
  }
  const Warp rough = fitWithoutStrays(columns, rows, known, pixels);
  if (!rough.isFinite()) return std::nullopt;

  Grid grid{columns, rows, {}, rough, Vector2d::Ones(), 0.0};
  const int count = columns * rows;
  const auto place = [&](int k) { return Vector2d(k % columns, k / columns); };
  const auto fitNear = [&](int k, const Vector2d& pixel, const Warp& warp,
                           const std::optional<Vector2d>& blur) {
    CornerGuess guess;
    guess.pixel = pixel;
    guess.axes = warp.jacobian(place(k));
    const double apart = spacing(guess.axes).minCoeff();
    if (blur)
      guess.blur_px = *blur;
    else
      guess.blur_px.setConstant(std::clamp(0.15 * apart, 0.6, 0.7 + 0.4 * scale));
    avoidHollow(board, columns, rows, place(k), guess);
    auto fit = fitCorner(gray, guess);
    const int expected = (k % columns + k / columns) % 2 == 0 ? side : -side;
    if (fit && fit->step * expected <= 0.0) fit.reset();
    return fit;
  };
  std::vector<std::optional<CornerFit>> fits(count);
  std::size_t next = 0;
  std::vector<Vector2d> fitted, fitted_pixels;
  std::vector<double> blur_u, blur_v;
  const auto failed = [&] { return count - static_cast<int>(fitted.size()); };
  for (int k = 0; k < count; ++k) {
    const bool is_known = next < known.size() && known[next] == place(k);
    fits[k] = fitNear(k, is_known ? pixels[next++] : rough.at(place(k)), rough, std::nullopt);
    if (fits[k]) {
      fitted.push_back(place(k));
      fitted_pixels.push_back(fits[k]->pixel);
      blur_u.push_back(fits[k]->blur_px.x());
      blur_v.push_back(fits[k]->blur_px.y());
    } else if ((k + 1 - static_cast<int>(fitted.size())) * 10 > count * 3) {
      return std::nullopt;
    }
  }
  // Corners that were not found, or found off the surface of the others, are tried once more where the
  // others say, with their blur.
  const Vector2d typical_blur(median(blur_u), median(blur_v));
  const bool complete = failed() == 0;
  const Warp better = fitWithoutStrays(columns, rows, fitted, fitted_pixels);
  if (!better.isFinite()) return std::nullopt;
  if (!complete || failed() > 0) {
    next = 0;
    for (int k = 0; k < count; ++k) {
      if (next < fitted.size() && fitted[next] == place(k)) {
        ++next;
        continue;
      }
      fits[k] = fitNear(k, better.at(place(k)), better, typical_blur);
      if (!fits[k]) return std::nullopt;
    }
  }
  std::vector<double> steps;
  for (const auto& fit : fits) {
    grid.corners.push_back(*fit);
    steps.push_back(std::abs(fit->step));
  }
  grid.blur_px = typical_blur;
  grid.step = median(steps);
  grid.warp = fitWarp(columns, rows, grid.corners);
  if (!grid.warp.isFinite() || !isSmooth(grid) || !isEven(grid)) return std::nullopt;

  // Now blur and directions are known from the whole board: only the position is left to each corner.
  for (int k = 0; k < columns * rows; ++k) {
    CornerGuess guess;
    guess.pixel = grid.corners[k].pixel;
    guess.axes = grid.warp.jacobian({k % columns, k / columns});
    guess.bend = grid.warp.bend({k % columns, k / columns});
    guess.blur_px = grid.blur_px;
    guess.fit_blur = false;
    avoidHollow(board, columns, rows, {k % columns, k / columns}, guess);
    // Beside the hollow square of a small or blurred board nothing may be left of this smaller window: the
    // first measurement stays.
    const Vector2d own_blur = grid.corners[k].blur_px;
    if (const auto fit = fitCorner(gray, guess))
      grid.corners[k] = *fit;
    else if (guess.hollow_quadrant.x() == 0)
      return std::nullopt;
    grid.corners[k].blur_px = own_blur;
  }
  grid.warp = fitWarp(columns, rows, grid.corners);
  if (!isSmooth(grid) || hasCoveredLine(grid)) return std::nullopt;
  return grid;
}

void remeasureBesideSolid(const cv::Mat& gray, const std::vector<Eigen::Vector2i>& solid, Grid& grid) {
  for (const Eigen::Vector2i& quadrant : solid) {
    const int column = quadrant.x() < 0 ? 0 : grid.columns - 1;
    const int row = quadrant.y() < 0 ? 0 : grid.rows - 1;
    CornerFit& corner = grid.corners[row * grid.columns + column];
    CornerGuess guess;
    guess.pixel = corner.pixel;
    guess.axes = grid.warp.jacobian({column, row});
    guess.bend = grid.warp.bend({column, row});
    guess.blur_px = grid.blur_px;
    guess.fit_blur = false;
    // What the whole window cannot measure stays as measured in a part of it.
    if (const auto fit = fitCorner(gray, guess)) corner = *fit;
  }
}

}  // namespace servocal::board
