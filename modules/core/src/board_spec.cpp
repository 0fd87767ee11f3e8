// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/board_spec.h"

#include <algorithm>
#include <cstdio>
#include <stdexcept>

namespace servocal {
namespace {

using Eigen::Vector2d;

// One overload set per question, one overload per pattern. Positions are of the upper left corner's frame's
// axes, centred later.

int count(const Checkerboard& p) { return p.cornerCount(); }
int count(const TagGrid& p) { return 4 * p.tags_x * p.tags_y; }
int count(const Charuco& p) { return (p.squares_x - 1) * (p.squares_y - 1); }
int count(const CircleGrid& p) { return p.circles_x * p.circles_y; }

Vector2d onGrid(int id, int columns, int rows, double step) {
  return step * Vector2d(id % columns - 0.5 * (columns - 1), id / columns - 0.5 * (rows - 1));
}

Vector2d position(const Checkerboard& p, int id) { return onGrid(id, p.cornersX(), p.cornersY(), p.square_size_m); }
Vector2d position(const Charuco& p, int id) { return onGrid(id, p.squares_x - 1, p.squares_y - 1, p.square_size_m); }
Vector2d position(const TagGrid& p, int id) {
  const Vector2d centre = onGrid(id / 4, p.tags_x, p.tags_y, p.tag_size_m + p.tag_gap_m);
  const int k = id % 4;  // Clockwise from the upper left.
  return centre + 0.5 * p.tag_size_m * Vector2d(k == 1 || k == 2 ? 1 : -1, k >= 2 ? 1 : -1);
}
Vector2d position(const CircleGrid& p, int id) {
  if (!p.asymmetric) return onGrid(id, p.circles_x, p.circles_y, p.spacing_m);
  const int column = id % p.circles_x, row = id / p.circles_x;
  // Odd rows reach half a spacing farther right; the middle of all rows is the middle of both kinds.
  return {p.spacing_m * (column + 0.5 * (row % 2) - 0.5 * (p.circles_x - 0.5)),
          0.5 * p.spacing_m * (row - 0.5 * (p.circles_y - 1))};
}

Vector2d halfSize(const Checkerboard& p) { return 0.5 * p.square_size_m * Vector2d(p.squares_x, p.squares_y); }
Vector2d halfSize(const Charuco& p) { return 0.5 * p.square_size_m * Vector2d(p.squares_x, p.squares_y); }
Vector2d halfSize(const TagGrid& p) {
  return 0.5 * (p.tag_size_m * Vector2d(p.tags_x, p.tags_y) + p.tag_gap_m * Vector2d(p.tags_x - 1, p.tags_y - 1));
}
Vector2d halfSize(const CircleGrid& p) {
  const Vector2d last = position(p, count(p) - 1);
  const double reach = p.asymmetric ? 0.5 * p.spacing_m * (p.circles_x - 0.5) : last.x();
  return Vector2d(reach, last.y()) + Vector2d::Constant(0.5 * p.diameter_m * std::max(1.0, p.bigger_corner_ratio));
}

double step(const Checkerboard& p) { return p.square_size_m; }
double step(const Charuco& p) { return p.square_size_m; }
double step(const TagGrid& p) { return p.tags_x * p.tags_y > 1 ? std::min(p.tag_size_m, p.tag_gap_m) : p.tag_size_m; }
double step(const CircleGrid& p) { return p.asymmetric ? 0.70710678118654752 * p.spacing_m : p.spacing_m; }

int turns(const Checkerboard& p) {
  if (p.hollow_corner || (p.squares_x + p.squares_y) % 2 != 0) return 1;
  return p.squares_x == p.squares_y && p.squares_x % 2 != 0 ? 4 : 2;
}
int turns(const TagGrid&) { return 1; }
int turns(const Charuco&) { return 1; }
int turns(const CircleGrid& p) {
  if (p.bigger_corner_ratio != 1.0) return 1;
  if (p.asymmetric) return p.circles_y % 2 == 0 ? 2 : 1;  // With odd rows, half a turn shifts the rows.
  return p.circles_x == p.circles_y ? 4 : 2;
}

std::string mm(double metres) {
  char text[32];
  std::snprintf(text, sizeof text, "%g mm", metres * 1e3);
  return text;
}
std::string size(int x, int y) { return std::to_string(x) + " x " + std::to_string(y); }

std::string text(const Checkerboard& p) {
  return size(p.squares_x, p.squares_y) + " squares of " + mm(p.square_size_m) +
         (p.hollow_corner ? ", one corner hollow" : "");
}
std::string text(const TagGrid& p) {
  return size(p.tags_x, p.tags_y) + (p.tags_x * p.tags_y == 1 ? " tag" : " tags") + " of " + mm(p.tag_size_m) +
         " (" + p.family + ")";
}
std::string text(const Charuco& p) {
  return "ChArUco " + size(p.squares_x, p.squares_y) + " squares of " + mm(p.square_size_m) + " (" + p.dictionary + ")";
}
std::string text(const CircleGrid& p) {
  return size(p.circles_x, p.circles_y) + (p.asymmetric ? " circles, asymmetric, " : " circles ") + mm(p.spacing_m) +
         " apart" + (p.bigger_corner_ratio != 1.0 ? ", one corner bigger" : "");
}

std::vector<Eigen::Vector3d> rectangle(const Vector2d& half) {
  return {{-half.x(), -half.y(), 0}, {half.x(), -half.y(), 0}, {half.x(), half.y(), 0}, {-half.x(), half.y(), 0}};
}

template <typename Question>
auto ask(const BoardSpec& board, const Question& question) {
  return std::visit(question, board.pattern);
}

}  // namespace

int TagGrid::code(int place) const {
  const int row = place / tags_x;
  return first_id + (first_row_is_lowest ? tags_y - 1 - row : row) * tags_x + place % tags_x;
}

int BoardSpec::cornerCount() const {
  return ask(*this, [](const auto& p) { return count(p); });
}

Eigen::Vector3d BoardSpec::corner(int id) const {
  const Vector2d p = ask(*this, [id](const auto& kind) { return position(kind, id); });
  return {p.x(), p.y(), 0.0};
}

std::vector<Eigen::Vector3d> BoardSpec::corners() const {
  std::vector<Eigen::Vector3d> points;
  for (int id = 0; id < cornerCount(); ++id) points.push_back(corner(id));
  return points;
}

double BoardSpec::spacing() const {
  return ask(*this, [](const auto& p) { return step(p); });
}

std::vector<Eigen::Vector3d> BoardSpec::patternOutline() const {
  return rectangle(ask(*this, [](const auto& p) { return halfSize(p); }));
}

std::vector<Eigen::Vector3d> BoardSpec::outline() const {
  return rectangle(ask(*this, [](const auto& p) { return halfSize(p); }) + Vector2d::Constant(margin_m));
}

int BoardSpec::symmetry() const {
  return ask(*this, [](const auto& p) { return turns(p); });
}

int BoardSpec::turnedId(int id, int turn) const {
  const int symmetry = this->symmetry();
  if (turn < 0 || turn >= symmetry) throw std::invalid_argument("BoardSpec::turnedId: no such turn");
  if (turn == 0) return id;
  const int count = cornerCount();
  if (symmetry == 2 || turn == 2) return count - 1 - id;
  // Only square grids have quarter turns: (x, y) -> (-y, x).
  int side = 1;
  while (side * side < count) ++side;
  const int column = side - 1 - id / side, row = id % side;
  const int quarter = row * side + column;
  return turn == 1 ? quarter : count - 1 - quarter;
}

std::string BoardSpec::describe() const {
  return ask(*this, [](const auto& p) { return text(p); });
}

}  // namespace servocal
