// SPDX-License-Identifier: GPL-3.0-or-later
#include "tag_group.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>

#include "warp.h"

namespace servocal::board {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;

constexpr double kTolerance = 0.5;  // Of a tag's shortest side in the image; neighbors are farther apart.

Matrix3d homographyOf(const std::vector<PlacedTag>& tags, const std::vector<std::size_t>& which) {
  std::vector<Vector2d> from, to;
  for (const std::size_t k : which) {
    from.insert(from.end(), tags[k].on_board.begin(), tags[k].on_board.end());
    to.insert(to.end(), tags[k].fit.corners.begin(), tags[k].fit.corners.end());
  }
  return fitHomography(from, to);
}

bool agrees(const Matrix3d& homography, const PlacedTag& tag) {
  const double tolerance = kTolerance * shortestSide(tag.fit.corners);
  for (int k = 0; k < 4; ++k) {
    const Eigen::Vector3d p = homography * tag.on_board[k].homogeneous();
    if (!(std::abs(p.z()) > 1e-9) || !((p.hnormalized() - tag.fit.corners[k]).norm() < tolerance))
      return false;
  }
  return true;
}

std::vector<std::size_t> agreeing(const Matrix3d& homography, const std::vector<PlacedTag>& tags) {
  std::vector<std::size_t> which;
  for (std::size_t k = 0; k < tags.size(); ++k)
    if (agrees(homography, tags[k])) which.push_back(k);
  return which;
}

}  // namespace

Vector2d centreOf(const TagCorners& corners) {
  return 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
}

std::vector<PlacedTag> agreeingTags(const std::vector<PlacedTag>& tags, bool several) {
  if (tags.empty() || (several && tags.size() < 2)) return {};
  if (tags.size() == 1) return tags;
  // Pairs at random, but the same ones every time.
  constexpr int kTrials = 60;
  std::minstd_rand random(1);
  std::vector<std::size_t> best;
  for (int trial = 0; trial < kTrials && best.size() < tags.size(); ++trial) {
    const std::size_t a = random() % tags.size();
    const std::size_t b = (a + 1 + random() % (tags.size() - 1)) % tags.size();
    std::vector<std::size_t> which = agreeing(homographyOf(tags, {a, b}), tags);
    if (which.size() < 2) continue;
    which = agreeing(homographyOf(tags, which), tags);
    if (which.size() > best.size()) best = which;
  }
  if (best.size() < 2 || 2 * best.size() <= tags.size()) return {};
  std::vector<PlacedTag> chosen;
  for (const std::size_t k : best) chosen.push_back(tags[k]);
  return chosen;
}

Matrix3d localHomography(const std::vector<PlacedTag>& tags, const Vector2d& on_board, std::size_t nearest) {
  std::vector<std::size_t> order(tags.size());
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
  const auto distance = [&](std::size_t k) { return (centreOf(tags[k].on_board) - on_board).squaredNorm(); };
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return distance(a) < distance(b); });
  order.resize(std::min(order.size(), nearest));
  return homographyOf(tags, order);
}

TagCorners predictTag(const std::vector<PlacedTag>& tags, const TagCorners& on_board, std::size_t nearest) {
  const Matrix3d homography = localHomography(tags, centreOf(on_board), nearest);
  TagCorners predicted;
  for (int k = 0; k < 4; ++k) predicted[k] = (homography * on_board[k].homogeneous()).hnormalized();
  return predicted;
}

}  // namespace servocal::board
