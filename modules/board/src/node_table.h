// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <vector>

#include "lattice.h"

namespace servocal::board {

/// A lattice's nodes by place, in an array: a texture may have thousands of them, each looked up many times.
/// Holds as long as the lattice does; nodes that are added to the lattice are to be added here too.
class NodeTable {
 public:
  explicit NodeTable(const Lattice& lattice) {
    if (lattice.nodes.empty()) return;
    low_ = high_ = place(lattice.nodes.begin()->first);
    for (const auto& [key, node] : lattice.nodes) {
      low_ = low_.cwiseMin(place(key));
      high_ = high_.cwiseMax(place(key));
    }
    reserve(0);
    for (const auto& [key, node] : lattice.nodes) nodes_[index(key.first, key.second)] = &node;
  }

  const Lattice::Node* at(int i, int j) const { return inside(i, j) ? nodes_[index(i, j)] : nullptr; }

  void add(int i, int j, const Lattice::Node& node) {
    low_ = low_.cwiseMin(Eigen::Vector2i(i, j));
    high_ = high_.cwiseMax(Eigen::Vector2i(i, j));
    if (!inside(i, j)) {
      constexpr int kSpare = 8;  // Places to every side, for those that follow.
      const NodeTable old = *this;
      reserve(kSpare);
      for (int y = old.first_.y(); y < old.first_.y() + old.size_.y(); ++y)
        for (int x = old.first_.x(); x < old.first_.x() + old.size_.x(); ++x)
          nodes_[index(x, y)] = old.nodes_[old.index(x, y)];
    }
    nodes_[index(i, j)] = &node;
  }

  /// Smallest and largest i and j of a node.
  const Eigen::Vector2i& low() const { return low_; }
  const Eigen::Vector2i& high() const { return high_; }

 private:
  static Eigen::Vector2i place(const std::pair<int, int>& key) { return {key.first, key.second}; }

  bool inside(int i, int j) const {
    const int x = i - first_.x(), y = j - first_.y();
    return x >= 0 && y >= 0 && x < size_.x() && y < size_.y();
  }
  std::size_t index(int i, int j) const {
    return static_cast<std::size_t>(j - first_.y()) * size_.x() + (i - first_.x());
  }
  void reserve(int spare) {
    first_ = low_.array() - spare;
    size_ = (high_ - first_).array() + spare + 1;
    nodes_.assign(static_cast<std::size_t>(size_.x()) * size_.y(), nullptr);
  }

  Eigen::Vector2i low_{0, 0}, high_{-1, -1};
  Eigen::Vector2i first_{0, 0}, size_{0, 0};  // Of the array.
  std::vector<const Lattice::Node*> nodes_;
};

}  // namespace servocal::board
