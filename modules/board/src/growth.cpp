// SPDX-License-Identifier: GPL-3.0-or-later
#include "growth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>

#include "linker.h"
#include "node_table.h"

namespace servocal::board {
namespace {

using Eigen::Vector2f;

// What the four squares around a corner look like.
struct Look {
  float step = 0;  // Half the difference of the means: > 0 if bright where i and j grow or fall together.
  float gap = -1;  // Between the darkest bright and the brightest dark square; < 0 if they overlap.
};

// Samples the squares around `p`, whose sides are the vectors `along_i` and `along_j`.
Look lookAt(const cv::Mat& smoothed, const Vector2f& p, const Vector2f& along_i, const Vector2f& along_j) {
  constexpr float kIn = 0.4f;  // squares: where the blur of the edges is least, short of the middle.
  const Vector2f even = kIn * (along_i + along_j), odd = kIn * (along_i - along_j);
  const std::array<Vector2f, 4> at{p + even, p - even, p + odd, p - odd};
  for (const Vector2f& q : at)
    if (!(q.x() >= 0 && q.y() >= 0 && q.x() < smoothed.cols - 1 && q.y() < smoothed.rows - 1)) return {};
  const float a = sample(smoothed, at[0]), b = sample(smoothed, at[1]);
  const float c = sample(smoothed, at[2]), d = sample(smoothed, at[3]);
  Look look;
  look.step = 0.25f * (a + b - c - d);
  look.gap = look.step > 0 ? std::min(a, b) - std::max(c, d) : std::min(c, d) - std::max(a, b);
  return look;
}

// True if a corner looks as the one beside it does, colors exchanged: not the end of the pattern, where
// three of the squares have one color.
bool continues(const Look& look, const Look& beside) {
  const float step = std::abs(look.step), before = std::abs(beside.step);
  return look.step * beside.step < 0 && look.gap > 0.3f * step && step > 0.5f * before &&
         step < 2.0f * before;
}

}  // namespace

void growByPrediction(const cv::Mat& smoothed, Lattice& lattice, const PlaceIndex& index,
                      const std::vector<Saddle>& saddles, std::vector<bool>& used) {
  using Key = std::pair<int, int>;
  NodeTable nodes(lattice);
  std::deque<Key> open;
  for (const auto& [key, node] : lattice.nodes) open.push_back(key);
  while (!open.empty()) {
    const auto [oi, oj] = open.front();
    open.pop_front();
    for (int axis = 0; axis < 4; ++axis) {
      const int i = oi + kStepI[axis];
      const int j = oj + kStepJ[axis];
      if (nodes.at(i, j)) continue;
      // Mean of the parallelograms and straight continuations that end here.
      Vector2f sum = Vector2f::Zero();
      int count = 0;
      float spacing = 1e9f;
      for (int a = 0; a < 4; ++a) {
        const Lattice::Node* near = nodes.at(i - kStepI[a], j - kStepJ[a]);
        if (!near) continue;
        if (const Lattice::Node* far = nodes.at(i - 2 * kStepI[a], j - 2 * kStepJ[a])) {
          sum += 2.0f * near->pixel - far->pixel;
          ++count;
          spacing = std::min(spacing, (near->pixel - far->pixel).norm());
        }
        const int b = (a + 1) % 4;
        const Lattice::Node* side_near = nodes.at(i - kStepI[b], j - kStepJ[b]);
        const Lattice::Node* opposite = nodes.at(i - kStepI[a] - kStepI[b], j - kStepJ[a] - kStepJ[b]);
        if (side_near && opposite) {
          sum += near->pixel + side_near->pixel - opposite->pixel;
          ++count;
          spacing = std::min(spacing, (near->pixel - opposite->pixel).norm());
        }
      }
      if (count < 1) continue;
      const Vector2f predicted = sum / static_cast<float>(count);
      if (!(predicted.array() >= 0).all()) continue;
      float best_distance = std::clamp(0.25f * spacing, 1.2f, 3.9f);
      int best = -1;
      index.near(predicted, [&](int k) {
        const float distance = (saddles[k].pixel - predicted).norm();
        if (used[k] || distance >= best_distance) return;
        best = k;
        best_distance = distance;
      });
      if (best < 0) continue;
      // The squares' sides, as at the node this one continues.
      const Lattice::Node& near = *nodes.at(oi, oj);
      const Vector2f out = saddles[best].pixel - near.pixel;
      const int across = (axis + 1) % 4;  // Turned by +90 degrees.
      const Lattice::Node* left = nodes.at(oi + kStepI[across], oj + kStepJ[across]);
      const Lattice::Node* right = nodes.at(oi - kStepI[across], oj - kStepJ[across]);
      if (!left && !right) continue;
      const Vector2f side = left && right ? Vector2f(0.5f * (left->pixel - right->pixel))
                            : left        ? Vector2f(left->pixel - near.pixel)
                                          : Vector2f(near.pixel - right->pixel);
      const Look look = lookAt(smoothed, saddles[best].pixel, out, side);
      if (!continues(look, lookAt(smoothed, near.pixel, out, side))) continue;
      used[best] = true;
      nodes.add(i, j, lattice.nodes[Key(i, j)] = {saddles[best].pixel, -near.side});
      open.push_back(Key(i, j));
      open.push_back(Key(oi, oj));
    }
  }
}

void dropStrays(const cv::Mat& smoothed, Lattice& lattice) {
  const NodeTable nodes(lattice);
  std::vector<std::pair<int, int>> strays;
  for (const auto& [key, node] : lattice.nodes) {
    std::array<const Lattice::Node*, 4> beside{};
    for (int axis = 0; axis < 4; ++axis)
      beside[axis] = nodes.at(key.first + kStepI[axis], key.second + kStepJ[axis]);
    const auto along = [&beside, pixel = node.pixel](int axis) {
      const Lattice::Node *ahead = beside[axis], *behind = beside[axis + 2];
      if (ahead && behind) return Vector2f(0.5f * (ahead->pixel - behind->pixel));
      if (ahead) return Vector2f(ahead->pixel - pixel);
      return behind ? Vector2f(pixel - behind->pixel) : Vector2f(Vector2f::Zero());
    };
    const Vector2f along_i = along(0), along_j = along(1);
    bool stray = along_i.isZero() || along_j.isZero();
    if (!stray) {
      const Look look = lookAt(smoothed, node.pixel, along_i, along_j);
      int good = 0, all = 0;
      for (const Lattice::Node* other : beside) {
        if (!other) continue;
        ++all;
        good += continues(look, lookAt(smoothed, other->pixel, along_i, along_j));
      }
      stray = 2 * good < all || good == 0;
    }
    if (stray) strays.push_back(key);
  }
  for (const auto& key : strays) lattice.nodes.erase(key);
}

std::vector<Lattice> growLattices(const cv::Mat& smoothed, const std::vector<Saddle>& saddles, int min_nodes,
                                  float longest_px) {
  const float reach = std::min(20.0f, longest_px);  // Farther apart, edges are followed more surely.
  constexpr std::size_t kMostPairs = 5;
  const int count = static_cast<int>(saddles.size());
  if (count < min_nodes) return {};
  const PlaceIndex index(smoothed.size(), saddles);
  const auto similar = [&](int a, int b) {
    const float ratio = saddles[a].contrast / saddles[b].contrast;
    return ratio > 0.4f && ratio < 2.5f;
  };
  std::vector<Lattice> lattices;
  std::vector<bool> used(count, false);
  struct Pair {
    int ahead, behind;
    Vector2f half;  // From the middle to the one ahead.
  };
  std::vector<Pair> pairs;
  for (int seed = 0; seed < count; ++seed) {
    if (used[seed]) continue;
    const Vector2f centre = saddles[seed].pixel;
    // Saddles in pairs on opposite sides, nearest first.
    pairs.clear();
    index.around(centre, static_cast<int>(reach) / PlaceIndex::kCell, [&](int ahead) {
      const Vector2f way = saddles[ahead].pixel - centre;
      const float length = way.norm();
      if (used[ahead] || length > reach || length < 2.0f || !similar(seed, ahead)) return;
      if (way.x() < 0 || (way.x() == 0 && way.y() < 0)) return;  // The other one of a pair finds this one.
      float nearest = std::min(0.15f * length + 0.7f, 2.0f);
      int behind = -1;
      index.near(centre - way, [&](int k) {
        const float distance = (saddles[k].pixel - centre + way).norm();
        if (used[k] || distance >= nearest || k == seed || !similar(seed, k)) return;
        nearest = distance;
        behind = k;
      });
      if (behind >= 0)
        pairs.push_back({ahead, behind, 0.5f * (saddles[ahead].pixel - saddles[behind].pixel)});
    });
    if (pairs.size() < 2) continue;
    std::sort(pairs.begin(), pairs.end(),
              [](const Pair& a, const Pair& b) { return a.half.squaredNorm() < b.half.squaredNorm(); });
    if (pairs.size() > kMostPairs) pairs.resize(kMostPairs);
    // A cross of two pairs whose five squares' corners alternate.
    const auto isCross = [&](const Pair& a, const Pair& b) {
      const Look middle = lookAt(smoothed, centre, a.half, b.half);
      if (middle.gap <= 0.3f * std::abs(middle.step)) return false;
      for (const int k : {a.ahead, a.behind, b.ahead, b.behind})
        if (!continues(lookAt(smoothed, saddles[k].pixel, a.half, b.half), middle)) return false;
      return true;
    };
    bool grown = false;
    for (std::size_t second = 1; second < pairs.size() && !grown; ++second) {
      for (std::size_t first = 0; first < second && !grown; ++first) {
        const Pair &a = pairs[first], &b = pairs[second];
        const float area = a.half.x() * b.half.y() - a.half.y() * b.half.x();
        if (std::abs(area) < 0.15f * a.half.norm() * b.half.norm() || !isCross(a, b)) continue;
        grown = true;
        const bool mirrored = area < 0;
        const int side = (lookAt(smoothed, centre, a.half, b.half).step > 0) == mirrored ? -1 : 1;
        Lattice lattice;
        lattice.nodes[{0, 0}] = {centre, side};
        lattice.nodes[{1, 0}] = {saddles[a.ahead].pixel, -side};
        lattice.nodes[{-1, 0}] = {saddles[a.behind].pixel, -side};
        lattice.nodes[{0, mirrored ? -1 : 1}] = {saddles[b.ahead].pixel, -side};
        lattice.nodes[{0, mirrored ? 1 : -1}] = {saddles[b.behind].pixel, -side};
        for (const int k : {seed, a.ahead, a.behind, b.ahead, b.behind}) used[k] = true;
        growByPrediction(smoothed, lattice, index, saddles, used);
        if (static_cast<int>(lattice.nodes.size()) >= min_nodes) lattices.push_back(std::move(lattice));
      }
    }
  }
  std::sort(lattices.begin(), lattices.end(),
            [](const Lattice& a, const Lattice& b) { return a.nodes.size() > b.nodes.size(); });
  return lattices;
}

}  // namespace servocal::board
