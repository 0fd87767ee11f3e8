// SPDX-License-Identifier: GPL-3.0-or-later
#include "mark.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>

#include "error_function.h"
#include "sample.h"

namespace servocal::board {
namespace {

using Eigen::Vector2d;

// A unit box from `from` to `to`, blurred, and the derivatives of that by place in units of blur.
struct Box {
  double value, slope, spread, curl;

  Box(double t, double from, double to, double blur) : value(0), slope(0), spread(0), curl(0) {
    static const ErrorFunction error_function;
    for (const double sign : {0.5, -0.5}) {
      const double at = (t - (sign > 0 ? from : to)) / blur;
      double edge, edge_slope;
      error_function.at(at, edge, edge_slope);
      value += sign * edge;
      slope += sign * edge_slope;
      spread += sign * at * edge_slope;
      curl += sign * (at * at - 1) * edge_slope;
    }
  }
};

// A rectangle, 1 inside and 0 outside, under a blur whose extents along u and v are correlated by rho, as they are
// where a square is seen as a rhombus (the tetrachoric series to its third power, as in the fit of corners).
double rectangle(const Box& u, const Box& v, double rho) {
  const double half = 0.5 * rho * rho;
  return u.value * v.value + rho * u.slope * v.slope + half * u.spread * v.spread + rho * half / 3 * u.curl * v.curl;
}

// What the corner cell diagonally beyond a corner of the grid looks like.
struct CornerCell {
  double hollow = 0.0;    // 1: hollow as printed; 0: solid.
  double residual = 1.0;  // RMS of what neither explains, in units of white minus black.
  bool is_cell = true;    // Contrast as on the rest of the board: a square, hollow or not.
  bool is_dark = true;    // The same if all of it is taken for one square.
};

std::optional<CornerCell> measureCornerCell(const cv::Mat& gray, const Grid& grid,
                                            const Eigen::Vector2i& quadrant, const Checkerboard& board) {
  const double u0 = quadrant.x() < 0 ? -1.0 : grid.columns - 1.0;
  const double v0 = quadrant.y() < 0 ? -1.0 : grid.rows - 1.0;
  const Eigen::Matrix2d axes = grid.warp.jacobian({u0 + 0.5, v0 + 0.5});
  const double area = std::abs(axes.determinant());
  // Blur in squares; edges along u (blur x) bound the cell in v.
  const double blur_v = std::max(grid.blur_px.x() / (area / axes.col(0).norm()), 0.02);
  const double blur_u = std::max(grid.blur_px.y() / (area / axes.col(1).norm()), 0.02);
  // Blur along u is due to the edges along v; both normals point where their coordinate grows.
  const Vector2d normal_u(axes(1, 1), -axes(0, 1)), normal_v(-axes(1, 0), axes(0, 0));
  const double ratio = grid.blur_px.x() / grid.blur_px.y();
  const double rho =
      std::clamp(normal_u.normalized().dot(normal_v.normalized()) * 0.5 * (ratio + 1 / ratio), -0.95, 0.95);
  const double inset = 0.5 * (1.0 - board.hollow_inner_ratio);

  // Regression of the brightness on: constant, the cell's own black, the white inside.
  constexpr int kSamples = 14;
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  double squares = 0.0;
  int count = 0;
  for (int b = 0; b < kSamples; ++b) {
    for (int a = 0; a < kSamples; ++a) {
      // A little over the cell's outer edges, so that the rim's white is part of the picture.
      double u = -0.25 + 1.25 * (a + 0.5) / kSamples;
      double v = -0.25 + 1.25 * (b + 0.5) / kSamples;
      if (quadrant.x() > 0) u = 1.0 - u;
      if (quadrant.y() > 0) v = 1.0 - v;
      const auto value = brightnessAt(gray, grid.warp.at({u0 + u, v0 + v}));
      if (!value) return std::nullopt;
      // The cell diagonally inside is black as well.
      const double u_inner = quadrant.x() < 0 ? 1.0 : -1.0;
      const double v_inner = quadrant.y() < 0 ? 1.0 : -1.0;
      const double solid =
          rectangle({u, 0, 1, blur_u}, {v, 0, 1, blur_v}, rho) +
          rectangle({u, u_inner, u_inner + 1, blur_u}, {v, v_inner, v_inner + 1, blur_v}, rho);
      const double inside =
          rectangle({u, inset, 1 - inset, blur_u}, {v, inset, 1 - inset, blur_v}, rho);
      const Eigen::Vector3d row(1.0, -solid, inside);
      normal += row * row.transpose();
      right += *value * row;
      squares += *value * *value;
      ++count;
    }
  }
  const Eigen::LDLT<Eigen::Matrix3d> solver(normal);
  const Eigen::Vector3d solution = solver.solve(right);
  if (!solution.allFinite()) return std::nullopt;
  const double contrast = 2.0 * grid.step;  // White minus black of the whole board.
  // The contrast of a solid square alone is known even where blur leaves so little difference between its picture and
  // that of its inside that the shares of the two are not.
  const double dark = normal(0, 1) / count;  // Mean picture of a solid square, negative.
  const double solid = (right[1] - dark * right[0]) / (normal(1, 1) - dark * normal(0, 1));
  CornerCell cell;
  cell.is_cell = solution[1] > 0.4 * contrast && solution[1] < 2.5 * contrast;
  cell.is_dark = solid > 0.35 * contrast && solid < 2.5 * contrast;
  cell.hollow = solution[2] / solution[1];
  cell.residual = std::sqrt(std::max(squares - solution.dot(right), 0.0) / count) / solution[1];
  // How strongly the white inside shows through the blur at all.
  const double visible =
      rectangle({0.5, inset, 1 - inset, blur_u}, {0.5, inset, 1 - inset, blur_v}, rho);
  if (visible < 0.25) return std::nullopt;
  return cell;
}

}  // namespace

Eigen::Vector2i Turn::corner(int x, int y, int columns, int rows) const {
  switch (quarters) {
    case 0: return {x, y};
    case 1: return {columns - 1 - y, x};
    case 2: return {columns - 1 - x, rows - 1 - y};
    default: return {y, rows - 1 - x};
  }
}

Eigen::Vector2i Turn::firstCorner() const {
  switch (quarters) {
    case 0: return {-1, -1};
    case 1: return {1, -1};
    case 2: return {1, 1};
    default: return {-1, 1};
  }
}

MarkResult findTurn(const cv::Mat& gray, const Grid& grid, const Checkerboard& board) {
  MarkResult result;
  // Turns whose dimensions fit, and whose square (0,0) is black: the one diagonally outside corner 0.
  for (int quarters = 0; quarters < 4; ++quarters) {
    const bool swapped = quarters % 2 == 1;
    if ((swapped ? grid.rows : grid.columns) != board.cornersX()) continue;
    if ((swapped ? grid.columns : grid.rows) != board.cornersY()) continue;
    const Turn turn{quarters};
    const Eigen::Vector2i first = turn.corner(0, 0, grid.columns, grid.rows);
    const Eigen::Vector2i quadrant = turn.firstCorner();
    // step > 0: bright where u and v grow together, which is where the outside cell lies if the signs of
    // its quadrant agree.
    const bool outside_is_white =
        (grid.at(first.x(), first.y()).step > 0) == (quadrant.x() * quadrant.y() > 0);
    if (!outside_is_white) result.turns.push_back(turn);
  }
  if (result.turns.empty()) return result;
  if (!board.hollow_corner) {
    result.status = result.turns.size() == 1 ? MarkStatus::kFound : MarkStatus::kUndecided;
    return result;
  }

  result.status = MarkStatus::kUndecided;
  constexpr double kHollow = 0.6, kMostHollow = 1.5;  // A solid square measures 0, a hollow one 1.
  constexpr double kSolid = 0.25, kLeastSolid = -0.6;  // Too dark an inside is no sign of a hollow square.
  constexpr double kMostResidual = 0.2;
  std::vector<Turn> hollow;
  bool clear = true;
  int foreign = 0;  // Places of the mark where nothing looks like a square of the board, solid or hollow.
  for (int quarters = 0; quarters < 4; ++quarters) {
    const Turn turn{quarters};
    const auto cell = measureCornerCell(gray, grid, turn.firstCorner(), board);
    const bool possible = std::any_of(result.turns.begin(), result.turns.end(),
                                      [&](const Turn& t) { return t.quarters == quarters; });
    const bool is_hollow = cell && cell->is_cell && cell->hollow > kHollow && cell->hollow < kMostHollow &&
                           cell->residual < kMostResidual;
    if (is_hollow) {
      // At a corner where this board cannot have it: the picture is mirrored, or another board.
      if (!possible) return {};
      hollow.push_back(turn);
    } else if (possible) {
      foreign += cell && !cell->is_dark;
      const bool is_solid = cell && cell->is_cell && cell->hollow <= kSolid && cell->hollow >= kLeastSolid &&
                            cell->residual <= kMostResidual;
      clear = clear && is_solid;
    }
  }
  // Something may hide one of the squares, but not all that could be the mark.
  if (foreign == static_cast<int>(result.turns.size())) return {};
  if (clear && hollow.size() == 1) {
    result.status = MarkStatus::kFound;
    result.turns = hollow;
  }
  return result;
}

}  // namespace servocal::board
