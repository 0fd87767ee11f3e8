// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/board_spec.h"

namespace servocal {
namespace {

std::vector<Eigen::Vector3d> rectangle(const BoardSpec& board, double rim_m) {
  const double half_x = 0.5 * board.squares_x * board.square_size_m + rim_m;
  const double half_y = 0.5 * board.squares_y * board.square_size_m + rim_m;
  return {{-half_x, -half_y, 0}, {half_x, -half_y, 0}, {half_x, half_y, 0}, {-half_x, half_y, 0}};
}

}  // namespace

Eigen::Vector3d BoardSpec::corner(int id) const {
  const int column = id % cornersX();
  const int row = id / cornersX();
  return {(column - 0.5 * (cornersX() - 1)) * square_size_m, (row - 0.5 * (cornersY() - 1)) * square_size_m,
          0.0};
}

std::vector<Eigen::Vector3d> BoardSpec::corners() const {
  std::vector<Eigen::Vector3d> points;
  for (int id = 0; id < cornerCount(); ++id) points.push_back(corner(id));
  return points;
}

std::vector<Eigen::Vector3d> BoardSpec::outline() const { return rectangle(*this, margin_m); }

std::vector<Eigen::Vector3d> BoardSpec::squaresOutline() const { return rectangle(*this, 0.0); }

bool BoardSpec::isSymmetric() const { return !hollow_corner && (squares_x + squares_y) % 2 == 0; }

}  // namespace servocal
