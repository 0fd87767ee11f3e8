// SPDX-License-Identifier: GPL-3.0-or-later
#include "placement.h"

#include <algorithm>

#include "node_table.h"

namespace servocal::board {
namespace {

using Eigen::Vector2i;

// How many nodes a rectangle of places has, from sums over the places above and left of each.
class NodeCounts {
 public:
  explicit NodeCounts(const NodeTable& nodes) : low_(nodes.low()), size_(nodes.high() - nodes.low()) {
    size_.array() += 1;
    counts_.assign(static_cast<std::size_t>(size_.x() + 1) * (size_.y() + 1), 0);
    for (int y = 0; y < size_.y(); ++y) {
      int in_row = 0;
      for (int x = 0; x < size_.x(); ++x) {
        in_row += nodes.at(low_.x() + x, low_.y() + y) != nullptr;
        counts_[index(x + 1, y + 1)] = counts_[index(x + 1, y)] + in_row;
      }
    }
  }

  // Nodes of (i0, j0) up to and without (i1, j1).
  int countIn(int i0, int j0, int i1, int j1) const {
    const int x0 = std::max(i0 - low_.x(), 0), x1 = std::min(i1 - low_.x(), size_.x());
    const int y0 = std::max(j0 - low_.y(), 0), y1 = std::min(j1 - low_.y(), size_.y());
    if (x0 >= x1 || y0 >= y1) return 0;
    return counts_[index(x1, y1)] - counts_[index(x0, y1)] - counts_[index(x1, y0)] + counts_[index(x0, y0)];
  }

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * (size_.x() + 1) + x; }

  Vector2i low_, size_;
  std::vector<int> counts_;
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
  const NodeCounts counts(nodes);
  const int i_min = nodes.low().x(), i_max = nodes.high().x(), j_min = nodes.low().y(),
            j_max = nodes.high().y();
  std::vector<Placement> placements;
  for (const bool turned : {false, true}) {
    if (turned && board.cornersX() == board.cornersY()) break;
    const int columns = turned ? board.cornersY() : board.cornersX();
    const int rows = turned ? board.cornersX() : board.cornersY();
    // One line may be missing altogether on each side.
    for (int j0 = std::min(j_min, j_max - rows + 1); j0 <= std::max(j_min, j_max - rows + 1); ++j0) {
      for (int i0 = std::min(i_min, i_max - columns + 1); i0 <= std::max(i_min, i_max - columns + 1); ++i0) {
        Placement placement{i0, j0, columns, rows, 0};
        placement.present = counts.countIn(i0, j0, i0 + columns, j0 + rows);
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
