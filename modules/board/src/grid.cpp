// SPDX-License-Identifier: GPL-3.0-or-later
#include "grid.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace servocal::board {
namespace {

using Eigen::Vector2d;

double median(std::vector<double> values) {
  const auto middle = values.begin() + values.size() / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

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

// Nodes on a line from (i, j) in steps of (di, dj) that continue the squares inside by a whole square;
// (oi, oj) points outwards.
int countLine(const Lattice& lattice, int i, int j, int di, int dj, int length, int oi, int oj) {
  int count = 0;
  for (int k = 0; k < length; ++k, i += di, j += dj) {
    const auto outer = lattice.nodes.find({i, j});
    const auto near = lattice.nodes.find({i - oi, j - oj});
    const auto far = lattice.nodes.find({i - 2 * oi, j - 2 * oj});
    const auto none = lattice.nodes.end();
    if (outer == none || near == none || far == none) continue;
    const Eigen::Vector2f last = near->second.pixel - far->second.pixel;
    const Eigen::Vector2f next = outer->second.pixel - near->second.pixel;
    if ((next - last).norm() < 0.3f * last.norm()) ++count;
  }
  return count;
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

// Mean brightness of the square that lies from a corner towards (du, dv), in signs, near that corner.
std::optional<double> quadrant(const cv::Mat& gray, const Vector2d& corner, const Eigen::Matrix2d& axes,
                               int du, int dv) {
  double sum = 0.0;
  for (const auto& [u, v] : {std::pair(0.25, 0.5), std::pair(0.4, 0.4), std::pair(0.5, 0.25)}) {
    const auto value = bilinear(gray, corner + axes * Vector2d(du * u, dv * v));
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

}  // namespace

double Grid::smallestSpacing() const {
  double smallest = 1e9;
  for (const double u : {0.0, columns - 1.0})
    for (const double v : {0.0, rows - 1.0})
      smallest = std::min(smallest, spacing(warp.jacobian({u, v})).minCoeff());
  return smallest;
}

std::vector<Placement> findPlacements(const Lattice& lattice, const Checkerboard& board) {
  if (lattice.nodes.empty()) return {};
  int i_min = 1 << 20, i_max = -(1 << 20), j_min = i_min, j_max = i_max;
  for (const auto& [key, node] : lattice.nodes) {
    i_min = std::min(i_min, key.first);
    i_max = std::max(i_max, key.first);
    j_min = std::min(j_min, key.second);
    j_max = std::max(j_max, key.second);
  }
  const auto countIn = [&](int i0, int i1, int j0, int j1) {
    int count = 0;
    for (int j = j0; j < j1; ++j)
      for (int i = i0; i < i1; ++i) count += static_cast<int>(lattice.nodes.count({i, j}));
    return count;
  };
  std::vector<Placement> placements;
  for (const bool turned : {false, true}) {
    if (turned && board.cornersX() == board.cornersY()) break;
    const int columns = turned ? board.cornersY() : board.cornersX();
    const int rows = turned ? board.cornersX() : board.cornersY();
    // One line may be missing altogether on each side.
    for (int j0 = std::min(j_min, j_max - rows + 1); j0 <= std::max(j_min, j_max - rows + 1); ++j0) {
      for (int i0 = std::min(i_min, i_max - columns + 1); i0 <= std::max(i_min, i_max - columns + 1); ++i0) {
        Placement placement{i0, j0, columns, rows, 0};
        placement.present = countIn(i0, i0 + columns, j0, j0 + rows);
        if (placement.present * 10 < columns * rows * 7 || placement.present < 4) continue;
        // Squares that go on beyond a side: the board is larger, or this is part of another pattern.
        const int i1 = i0 + columns, j1 = j0 + rows;
        const int left = countLine(lattice, i0 - 1, j0, 0, 1, rows, -1, 0);
        const int right = countLine(lattice, i1, j0, 0, 1, rows, 1, 0);
        const int top = countLine(lattice, i0, j0 - 1, 1, 0, columns, 0, -1);
        const int bottom = countLine(lattice, i0, j1, 1, 0, columns, 0, 1);
        if (3 * std::max(left, right) > rows || 3 * std::max(top, bottom) > columns) continue;
        if (5 * (left + right + top + bottom) > 2 * (columns + rows)) continue;
        placements.push_back(placement);
      }
    }
  }
  std::stable_sort(placements.begin(), placements.end(),
                   [](const Placement& a, const Placement& b) { return a.present > b.present; });
  constexpr std::size_t kMostPlacements = 4;
  if (placements.size() > kMostPlacements) placements.resize(kMostPlacements);
  return placements;
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
    guess.blur_px = grid.blur_px;
    guess.fit_blur = false;
    avoidHollow(board, columns, rows, {k % columns, k / columns}, guess);
    // Beside the hollow square of a small or blurred board nothing may be left of this smaller window: the
    // first measurement stays.
    if (const auto fit = fitCorner(gray, guess))
      grid.corners[k] = *fit;
    else if (guess.hollow_quadrant.x() == 0)
      return std::nullopt;
  }
  grid.warp = fitWarp(columns, rows, grid.corners);
  if (!isSmooth(grid)) return std::nullopt;
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
    guess.blur_px = grid.blur_px;
    guess.fit_blur = false;
    // What the whole window cannot measure stays as measured in a part of it.
    if (const auto fit = fitCorner(gray, guess)) corner = *fit;
  }
}

std::optional<double> bilinear(const cv::Mat& gray, const Vector2d& p) {
  if (!(p.x() >= 0 && p.y() >= 0 && p.x() < gray.cols - 1 && p.y() < gray.rows - 1)) return std::nullopt;
  const int x = static_cast<int>(p.x());
  const int y = static_cast<int>(p.y());
  const double fx = p.x() - x, fy = p.y() - y;
  const uchar* a = gray.ptr<uchar>(y) + x;
  const uchar* b = gray.ptr<uchar>(y + 1) + x;
  return (1 - fy) * ((1 - fx) * a[0] + fx * a[1]) + fy * ((1 - fx) * b[0] + fx * b[1]);
}

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

namespace {

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
        const auto value = bilinear(gray, grid.warp.at(Vector2d(column + du, row + dv)));
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
  if (!showsCorners(gray, grid, board) || showsDots(gray, grid)) return false;
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
