// SPDX-License-Identifier: GPL-3.0-or-later
#include "lattice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>

#include "node_table.h"

namespace servocal::board {
namespace {

using Eigen::Vector2f;

inline float sample(const cv::Mat& smoothed, const Vector2f& p) {
  const int x = static_cast<int>(p.x());
  const int y = static_cast<int>(p.y());
  const float fx = p.x() - x;
  const float fy = p.y() - y;
  const short* a = smoothed.ptr<short>(y) + x;
  const short* b = smoothed.ptr<short>(y + 1) + x;
  return (1 - fy) * ((1 - fx) * a[0] + fx * a[1]) + fy * ((1 - fx) * b[0] + fx * b[1]);
}

// Saddle points by place, for lookups within a few pixels.
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
  void near(const Vector2f& p, Visit visit) const {
    const int centre = cell(p);
    if (!is_near_[centre]) return;
    for (int dy = -columns_; dy <= columns_; dy += columns_)
      for (int dx = -1; dx <= 1; ++dx)
        for (int k = first_[centre + dy + dx]; k >= 0; k = next_[k]) visit(k);
  }

  // The same for all within `reach` cells to every side.
  template <class Visit>
  void around(const Vector2f& p, int reach, Visit visit) const {
    const int centre = cell(p);
    const int x = centre % columns_, y = centre / columns_;
    for (int row = std::max(y - reach, 0); row <= std::min(y + reach, rows_ - 1); ++row)
      for (int column = std::max(x - reach, 0); column <= std::min(x + reach, columns_ - 1); ++column)
        for (int k = first_[row * columns_ + column]; k >= 0; k = next_[k]) visit(k);
  }

 private:
  int cell(const Vector2f& p) const {
    const int x = std::clamp(static_cast<int>(p.x()) / kCell, 0, columns_ - 3) + 1;
    const int y = std::clamp(static_cast<int>(p.y()) / kCell, 0, rows_ - 3) + 1;
    return y * columns_ + x;
  }

  int columns_, rows_;
  std::vector<int> first_, next_;
  std::vector<unsigned char> is_near_;  // Whether a cell or one beside it holds a saddle: most do not.
};

struct Link {
  int node = -1;
  int ray = 0;  // The ray of `node` that points back.
};

class Linker {
 public:
  Linker(const cv::Mat& smoothed, const std::vector<Saddle>& saddles, float longest_px)
      : smoothed_(smoothed), saddles_(saddles), index_(smoothed.size(), saddles), longest_px_(longest_px) {}

  // Follows ray k of saddle `from` until the next saddle point, or until the edge ends or is too long.
  Link follow(int from, int k) const {
    constexpr float kStep = 1.5f;    // px; farther from the corner, where the direction is known,
    constexpr float kStride = 2.0f;  // so many: the next corner is still met within 2.5 px.
    constexpr float kKnown = 6.0f;   // px
    constexpr float kBlind = 3.0f;   // px; next to a corner its other edge disturbs.
    constexpr int kMaxMisses = 3;
    const Saddle& start = saddles_[from];
    const int side = start.raySide(k);
    const float least_step = 0.25f * start.contrast;
    Vector2f direction = start.rays[k];
    Vector2f p = start.pixel;
    float gone = 0;
    int misses = 0;
    while (true) {
      p += (gone > kKnown ? kStride : kStep) * direction;
      if (!inside(p)) return {};
      gone = (p - start.pixel).norm();
      if (gone > longest_px_) return {};
      const Link link = arrival(from, side, p, gone);
      if (link.node >= 0) return link;
      if (gone < kBlind) continue;
      const Vector2f normal(-direction.y(), direction.x());
      // Brightness across the edge, oriented so that it rises.
      std::array<float, 5> profile;
      for (int s = -2; s <= 2; ++s)
        profile[s + 2] = side * sample(smoothed_, p + static_cast<float>(s) * normal);
      if (profile[4] - profile[0] < least_step && profile[3] - profile[1] < least_step) {
        if (++misses > kMaxMisses) return {};
        continue;
      }
      misses = 0;
      float weight = 0, moment = 0;
      for (int s = 0; s < 4; ++s) {
        const float rise = std::max(profile[s + 1] - profile[s], 0.0f);
        weight += rise;
        moment += rise * (s - 1.5f);
      }
      p += 0.5f * std::clamp(moment / weight, -1.0f, 1.0f) * normal;
      // The longer the way, the better the direction is known from its two ends.
      if (gone > kKnown) direction = (p - start.pixel).normalized();
    }
  }

 private:
  bool inside(const Vector2f& p) const {
    return p.x() >= 3 && p.y() >= 3 && p.x() < smoothed_.cols - 4 && p.y() < smoothed_.rows - 4;
  }

  Link arrival(int from, int side, const Vector2f& p, float gone) const {
    const Vector2f start = saddles_[from].pixel;
    Link best;
    float best_distance = 2.5f;  // px
    index_.near(p, [&](int k) {
      if (k == from) return;
      const Saddle& candidate = saddles_[k];
      const float distance = (candidate.pixel - p).norm();
      if (distance >= best_distance) return;
      const Vector2f way = candidate.pixel - start;
      const float length = way.norm();
      if (length < 2.5f || gone < 1.5f) return;
      const float other = candidate.contrast / saddles_[from].contrast;
      if (other < 0.25f || other > 4.0f) return;
      for (int ray = 0; ray < 4; ++ray) {
        // Turned back, left and right change places; so does black and white at the next corner.
        if (candidate.raySide(ray) != -side || candidate.rays[ray].dot(way) > -0.85f * length) continue;
        best = {k, ray};
        best_distance = distance;
      }
    });
    return best;
  }

  const cv::Mat& smoothed_;
  const std::vector<Saddle>& saddles_;
  PlaceIndex index_;
  float longest_px_;
};

// Steps along the four axes +i, +j, -i, -j.
constexpr int kStepI[4] = {1, 0, -1, 0};
constexpr int kStepJ[4] = {0, 1, 0, -1};

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

// Adds saddles that no edge led to, where their neighbors say one should be and the squares agree.
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

// Takes away what edges led to but does not look like a corner of the same pattern.
void dropStrays(const cv::Mat& smoothed, Lattice& lattice) {
  const NodeTable nodes(lattice);
  std::vector<std::pair<int, int>> strays;
  for (const auto& [key, node] : lattice.nodes) {
    std::array<const Lattice::Node*, 4> beside{};
    for (int axis = 0; axis < 4; ++axis)
      beside[axis] = nodes.at(key.first + kStepI[axis], key.second + kStepJ[axis]);
    const auto along = [&](int axis) {
      const Lattice::Node *ahead = beside[axis], *behind = beside[axis + 2];
      if (ahead && behind) return Vector2f(0.5f * (ahead->pixel - behind->pixel));
      if (ahead) return Vector2f(ahead->pixel - node.pixel);
      return behind ? Vector2f(node.pixel - behind->pixel) : Vector2f(Vector2f::Zero());
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

}  // namespace

std::vector<Saddle> withoutTwins(const cv::Size& size, const std::vector<Saddle>& saddles) {
  const PlaceIndex index(size, saddles);
  std::vector<Saddle> kept;
  for (int k = 0; k < static_cast<int>(saddles.size()); ++k) {
    bool twin = false;
    index.near(saddles[k].pixel, [&](int other) {
      if (other == k || (saddles[other].pixel - saddles[k].pixel).squaredNorm() > 2.0f * 2.0f) return;
      const int mine = saddles[k].response;
      const int theirs = saddles[other].response;
      twin = twin || theirs > mine || (theirs == mine && other < k);
    });
    if (!twin) kept.push_back(saddles[k]);
  }
  return kept;
}

std::vector<Lattice> findLattices(const cv::Mat& smoothed, const std::vector<Saddle>& saddles, int min_nodes,
                                  float longest_px) {
  const int count = static_cast<int>(saddles.size());
  if (count < min_nodes) return {};
  const Linker linker(smoothed, saddles, longest_px);
  std::vector<std::array<Link, 4>> links(count);
  for (int k = 0; k < count; ++k) {
    for (const int ray : {0, 2}) links[k][ray] = linker.follow(k, ray);
    // A corner of a board has a neighbor on at least one side, along both of its edges.
    if (links[k][0].node < 0 && links[k][2].node < 0) continue;
    for (const int ray : {1, 3}) links[k][ray] = linker.follow(k, ray);
  }
  // A link counts if the way back agrees, or found nothing.
  for (int k = 0; k < count; ++k) {
    for (int ray = 0; ray < 4; ++ray) {
      Link& link = links[k][ray];
      if (link.node < 0) continue;
      Link& back = links[link.node][link.ray];
      if (back.node < 0) back = {k, ray};
      if (back.node != k || back.ray != ray) link.node = -1;
    }
  }

  // Connected pieces, largest first.
  struct Piece {
    Lattice lattice;
    std::vector<int> members;
  };
  std::vector<Piece> pieces;
  std::vector<bool> visited(count, false);
  std::vector<int> turn(count, 0);  // Ray k of a node is axis (k + turn) % 4.
  std::vector<std::pair<int, int>> place(count);
  for (int root = 0; root < count; ++root) {
    if (visited[root]) continue;
    Piece piece;
    const auto add = [&](int node, std::pair<int, int> key, int node_turn) {
      visited[node] = true;
      turn[node] = node_turn;
      place[node] = key;
      // Ray 0 has its left sector towards ray 1; in axes, the quadrant after axis `turn`.
      const int side = saddles[node].side * ((node_turn & 1) ? -1 : 1);
      piece.lattice.nodes[key] = {saddles[node].pixel, side};
      piece.members.push_back(node);
    };
    add(root, {0, 0}, 0);
    for (std::size_t m = 0; m < piece.members.size(); ++m) {
      const int node = piece.members[m];
      for (int ray = 0; ray < 4; ++ray) {
        const Link& link = links[node][ray];
        if (link.node < 0 || visited[link.node]) continue;
        const int axis = (ray + turn[node]) % 4;
        const std::pair<int, int> key(place[node].first + kStepI[axis], place[node].second + kStepJ[axis]);
        if (piece.lattice.nodes.count(key)) continue;
        // Neighboring squares are of about the same size and direction.
        const auto behind =
            piece.lattice.nodes.find({place[node].first - kStepI[axis], place[node].second - kStepJ[axis]});
        if (behind != piece.lattice.nodes.end()) {
          const Vector2f last = saddles[node].pixel - behind->second.pixel;
          const Vector2f next = saddles[link.node].pixel - saddles[node].pixel;
          if ((next - last).squaredNorm() > 0.4f * 0.4f * std::max(next.squaredNorm(), last.squaredNorm()))
            continue;
        }
        add(link.node, key, (axis + 2 - link.ray + 4) % 4);
      }
    }
    // A board in pieces is put together by prediction only if one piece is a good part of it.
    if (static_cast<int>(piece.members.size()) * 2 >= min_nodes) pieces.push_back(std::move(piece));
  }
  std::sort(pieces.begin(), pieces.end(),
            [](const Piece& a, const Piece& b) { return a.members.size() > b.members.size(); });

  std::vector<Lattice> lattices;
  const PlaceIndex index(smoothed.size(), saddles);
  std::vector<bool> used(count, false);
  for (Piece& piece : pieces) {
    if (used[piece.members.front()]) continue;  // Became part of a larger piece.
    for (const int node : piece.members) used[node] = true;
    dropStrays(smoothed, piece.lattice);
    growByPrediction(smoothed, piece.lattice, index, saddles, used);
    if (static_cast<int>(piece.lattice.nodes.size()) >= min_nodes)
      lattices.push_back(std::move(piece.lattice));
  }
  std::sort(lattices.begin(), lattices.end(),
            [](const Lattice& a, const Lattice& b) { return a.nodes.size() > b.nodes.size(); });
  return lattices;
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
