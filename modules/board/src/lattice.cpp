// SPDX-License-Identifier: GPL-3.0-or-later
#include "lattice.h"

#include <algorithm>
#include <array>

#include "growth.h"
#include "linker.h"

namespace servocal::board {

using Eigen::Vector2f;

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

}  // namespace servocal::board
