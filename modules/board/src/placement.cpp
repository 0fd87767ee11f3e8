// SPDX-License-Identifier: GPL-3.0-or-later
#include "placement.h"

#include <algorithm>

namespace servocal::board {
namespace {

using Eigen::Vector2i;

// A lattice's nodes by place, in an array: a texture may have thousands, and a board as many places in them.
class NodeTable {
 public:
  explicit NodeTable(const Lattice& lattice) {
    for (const auto& [key, node] : lattice.nodes) {
      low = low.cwiseMin(Vector2i(key.first, key.second));
      high = high.cwiseMax(Vector2i(key.first, key.second));
    }
    width_ = high.x() - low.x() + 1;
    const int height = high.y() - low.y() + 1;
    nodes_.assign(static_cast<std::size_t>(width_) * height, nullptr);
    for (const auto& [key, node] : lattice.nodes) nodes_[index(key.first, key.second)] = &node;
    counts_.assign(static_cast<std::size_t>(width_ + 1) * (height + 1), 0);
    std::size_t place = 0;
    for (int y = 0; y < height; ++y) {
      int in_row = 0;
      for (int x = 0; x < width_; ++x) {
        in_row += nodes_[place++] != nullptr;
        counts_[countIndex(x + 1, y + 1)] = counts_[countIndex(x + 1, y)] + in_row;
      }
    }
  }

  Vector2i low{1 << 20, 1 << 20}, high{-(1 << 20), -(1 << 20)};  // Of the places taken.

  const Lattice::Node* at(int i, int j) const {
    const bool inside = i >= low.x() && j >= low.y() && i <= high.x() && j <= high.y();
    return inside ? nodes_[index(i, j)] : nullptr;
  }

  // Nodes of (i0, j0) up to and without (i1, j1).
  int countIn(int i0, int j0, int i1, int j1) const {
    const int x0 = std::max(i0 - low.x(), 0), x1 = std::min(i1, high.x() + 1) - low.x();
    const int y0 = std::max(j0 - low.y(), 0), y1 = std::min(j1, high.y() + 1) - low.y();
    if (x0 >= x1 || y0 >= y1) return 0;
    return counts_[countIndex(x1, y1)] - counts_[countIndex(x0, y1)] - counts_[countIndex(x1, y0)] +
           counts_[countIndex(x0, y0)];
  }

 private:
  std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(j - low.y()) * width_ + (i - low.x());
  }
  std::size_t countIndex(int x, int y) const { return static_cast<std::size_t>(y) * (width_ + 1) + x; }

  int width_ = 0;
  std::vector<const Lattice::Node*> nodes_;
  std::vector<int> counts_;  // Of the nodes above and left of a place.
};

// Nodes on a line from (i, j) in steps of (di, dj) that continue the squares inside by a whole square;
// (oi, oj) points outwards.
int countLine(const NodeTable& nodes, int i, int j, int di, int dj, int length, int oi, int oj) {
  int count = 0;
  for (int k = 0; k < length; ++k, i += di, j += dj) {
    const Lattice::Node *outer = nodes.at(i, j), *near = nodes.at(i - oi, j - oj),
                        *far = nodes.at(i - 2 * oi, j - 2 * oj);
    if (!outer || !near || !far) continue;
    const Eigen::Vector2f last = near->pixel - far->pixel, next = outer->pixel - near->pixel;
    if ((next - last).norm() < 0.3f * last.norm()) ++count;
  }
  return count;
}

}  // namespace

std::vector<Placement> findPlacements(const Lattice& lattice, const Checkerboard& board) {
  if (lattice.nodes.empty()) return {};
  const NodeTable nodes(lattice);
  const int i_min = nodes.low.x(), i_max = nodes.high.x(), j_min = nodes.low.y(), j_max = nodes.high.y();
  std::vector<Placement> placements;
  for (const bool turned : {false, true}) {
    if (turned && board.cornersX() == board.cornersY()) break;
    const int columns = turned ? board.cornersY() : board.cornersX();
    const int rows = turned ? board.cornersX() : board.cornersY();
    // One line may be missing altogether on each side.
    for (int j0 = std::min(j_min, j_max - rows + 1); j0 <= std::max(j_min, j_max - rows + 1); ++j0) {
      for (int i0 = std::min(i_min, i_max - columns + 1); i0 <= std::max(i_min, i_max - columns + 1); ++i0) {
        Placement placement{i0, j0, columns, rows, 0};
        placement.present = nodes.countIn(i0, j0, i0 + columns, j0 + rows);
        if (placement.present * 10 < columns * rows * 7 || placement.present < 4) continue;
        // Squares that go on beyond a side: the board is larger, or this is part of another pattern.
        const int i1 = i0 + columns, j1 = j0 + rows;
        const int left = countLine(nodes, i0 - 1, j0, 0, 1, rows, -1, 0);
        const int right = countLine(nodes, i1, j0, 0, 1, rows, 1, 0);
        const int top = countLine(nodes, i0, j0 - 1, 1, 0, columns, 0, -1);
        const int bottom = countLine(nodes, i0, j1, 1, 0, columns, 0, 1);
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

}  // namespace servocal::board
