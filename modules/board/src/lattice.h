// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <map>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "saddle.h"

namespace servocal::board {

/// Saddle points joined by edges, with integer coordinates: i and j count squares along two directions
/// such that j is i turned by +90 degrees from x towards y (never a mirror image).
struct Lattice {
  struct Node {
    Eigen::Vector2f pixel;
    int side = 1;  ///< +1: brighter in the quadrants where i and j grow or fall together.
  };
  std::map<std::pair<int, int>, Node> nodes;
};

/// One response may leave two peaks a pixel or two apart: keeps the stronger.
std::vector<Saddle> withoutTwins(const cv::Size& size, const std::vector<Saddle>& saddles);

/// Follows the edges that leave each saddle point to the next saddle point and numbers what is connected.
/// Lattices of fewer than `min_nodes` are dropped; largest first. Edges longer than `longest_px` are given
/// up.
std::vector<Lattice> findLattices(const cv::Mat& smoothed, const std::vector<Saddle>& saddles, int min_nodes,
                                  float longest_px);

/// The same without edges, for squares so small or so foreshortened that there is no edge to follow between
/// two corners: starts from crosses of five saddle points whose squares alternate, and grows them.
std::vector<Lattice> growLattices(const cv::Mat& smoothed, const std::vector<Saddle>& saddles, int min_nodes,
                                  float longest_px);

}  // namespace servocal::board
