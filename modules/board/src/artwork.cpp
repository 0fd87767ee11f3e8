// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/board/artwork.h"

#include "tag_family.h"

namespace servocal::board {
namespace {

using Eigen::Vector2d;

Shape rectangle(const Vector2d& low, const Vector2d& size, bool black) {
  return {Shape::Kind::kRectangle, low + 0.5 * size, 0.5 * size, black};
}

// Squares of one color of a checkerboard whose upper left corner is `origin`.
void addSquares(const Vector2d& origin, int squares_x, int squares_y, double side, bool first_black,
                std::vector<Shape>& shapes) {
  for (int row = 0; row < squares_y; ++row) {
    for (int column = 0; column < squares_x; ++column) {
      if (((row + column) % 2 == 0) == first_black)
        shapes.push_back(rectangle(origin + side * Vector2d(column, row), Vector2d::Constant(side), true));
    }
  }
}

// A tag whose upper left is `origin`: black all over, then its white cells, row by row in runs.
void addTag(const Vector2d& origin, double side, const cv::Mat& cells, std::vector<Shape>& shapes) {
  const double cell = side / cells.cols;
  for (int row = 0; row < cells.rows; ++row) {
    for (int column = 0; column < cells.cols; ++column) {
      int end = column;
      while (end < cells.cols && cells.at<uchar>(row, end) != 0) ++end;
      if (end == column) continue;
      shapes.push_back(rectangle(origin + cell * Vector2d(column, row), cell * Vector2d(end - column, 1), false));
      column = end;
    }
  }
}

void add(const Checkerboard& p, std::vector<Shape>& shapes) {
  const Vector2d origin = -0.5 * p.square_size_m * Vector2d(p.squares_x, p.squares_y);
  addSquares(origin, p.squares_x, p.squares_y, p.square_size_m, true, shapes);
  if (!p.hollow_corner) return;
  const double inside = p.hollow_inner_ratio * p.square_size_m;
  shapes.push_back(rectangle(origin + Vector2d::Constant(0.5 * (p.square_size_m - inside)),
                             Vector2d::Constant(inside), false));
}

void add(const TagGrid& p, std::vector<Shape>& shapes) {
  const double pitch = p.tag_size_m + p.tag_gap_m;
  const Vector2d origin = -0.5 * (pitch * Vector2d(p.tags_x, p.tags_y) - Vector2d::Constant(p.tag_gap_m));
  const auto at = [&](int place) { return Vector2d(origin + pitch * Vector2d(place % p.tags_x, place / p.tags_x)); };
  for (int place = 0; place < p.tags_x * p.tags_y; ++place)
    shapes.push_back(rectangle(at(place), Vector2d::Constant(p.tag_size_m), true));
  for (int place = 0; place < p.tags_x * p.tags_y; ++place)
    addTag(at(place), p.tag_size_m, tagCells(p.family, p.code(place), p.border_bits), shapes);
}

void add(const Charuco& p, std::vector<Shape>& shapes) {
  const double side = p.square_size_m, inset = 0.5 * (side - p.marker_size_m);
  const Vector2d origin = -0.5 * side * Vector2d(p.squares_x, p.squares_y);
  addSquares(origin, p.squares_x, p.squares_y, side, !p.first_square_white, shapes);
  std::vector<Vector2d> markers;
  for (int row = 0; row < p.squares_y; ++row) {
    for (int column = 0; column < p.squares_x; ++column) {
      if (((row + column) % 2 == 0) == p.first_square_white)
        markers.push_back(origin + side * Vector2d(column, row) + Vector2d::Constant(inset));
    }
  }
  for (const Vector2d& marker : markers)
    shapes.push_back(rectangle(marker, Vector2d::Constant(p.marker_size_m), true));
  for (std::size_t code = 0; code < markers.size(); ++code)
    addTag(markers[code], p.marker_size_m, tagCells(p.dictionary, static_cast<int>(code), 1), shapes);
}

void addDiscs(const BoardSpec& board, const CircleGrid& p, std::vector<Shape>& shapes) {
  for (int id = 0; id < board.cornerCount(); ++id) {
    const double radius = 0.5 * p.diameter_m * (id == 0 ? p.bigger_corner_ratio : 1.0);
    shapes.push_back({Shape::Kind::kDisc, board.corner(id).head<2>(), Vector2d::Constant(radius), true});
  }
}

}  // namespace

std::vector<Shape> artwork(const BoardSpec& board) {
  std::vector<Shape> shapes;
  if (const auto* p = board.as<Checkerboard>()) add(*p, shapes);
  if (const auto* p = board.as<TagGrid>()) add(*p, shapes);
  if (const auto* p = board.as<Charuco>()) add(*p, shapes);
  if (const auto* p = board.as<CircleGrid>()) addDiscs(board, *p, shapes);
  return shapes;
}

}  // namespace servocal::board
