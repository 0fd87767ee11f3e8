// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <opencv2/core/types.hpp>
#include <vector>

#include "saddle.h"

namespace servocal::board {

/// Saddle points by place, for lookups within a few pixels.
class PlaceIndex {
 public:
  static constexpr int kCell = 4;  // px

  PlaceIndex(const cv::Size& size, const std::vector<Saddle>& saddles)
      : columns_(size.width / kCell + 3), rows_(size.height / kCell + 3),
        first_(static_cast<std::size_t>(columns_) * rows_, -1), next_(saddles.size(), -1),
        is_near_(first_.size(), 0) {
    for (int k = 0; k < static_cast<int>(saddles.size()); ++k) {
      const int here = cell(saddles[k].pixel);
      next_[k] = first_[here];
      first_[here] = k;
      for (int dy = -columns_; dy <= columns_; dy += columns_)
        for (int dx = -1; dx <= 1; ++dx) is_near_[here + dy + dx] = 1;
    }
  }

  // Calls visit(index) for every saddle in the cells around `p`, hence for all within kCell pixels.
  template <class Visit>
  void near(const Eigen::Vector2f& p, Visit visit) const {
    const int centre = cell(p);
    if (!is_near_[centre]) return;
    for (int dy = -columns_; dy <= columns_; dy += columns_)
      for (int dx = -1; dx <= 1; ++dx)
        for (int k = first_[centre + dy + dx]; k >= 0; k = next_[k]) visit(k);
  }

  // The same for all within `reach` cells to every side.
  template <class Visit>
  void around(const Eigen::Vector2f& p, int reach, Visit visit) const {
    const int centre = cell(p);
    const int x = centre % columns_, y = centre / columns_;
    for (int row = std::max(y - reach, 0); row <= std::min(y + reach, rows_ - 1); ++row)
      for (int column = std::max(x - reach, 0); column <= std::min(x + reach, columns_ - 1); ++column)
        for (int k = first_[row * columns_ + column]; k >= 0; k = next_[k]) visit(k);
  }

 private:
  int cell(const Eigen::Vector2f& p) const {
    const int x = std::clamp(static_cast<int>(p.x()) / kCell, 0, columns_ - 3) + 1;
    const int y = std::clamp(static_cast<int>(p.y()) / kCell, 0, rows_ - 3) + 1;
    return y * columns_ + x;
  }

  int columns_, rows_;
  std::vector<int> first_, next_;
  std::vector<unsigned char> is_near_;  // Whether a cell or one beside it holds a saddle: most do not.
};

}  // namespace servocal::board
