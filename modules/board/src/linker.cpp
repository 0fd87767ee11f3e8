// SPDX-License-Identifier: GPL-3.0-or-later
#include "linker.h"

#include <algorithm>
#include <array>

namespace servocal::board {

using Eigen::Vector2f;

Link Linker::follow(int from, int k) const {
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

bool Linker::inside(const Vector2f& p) const {
  return p.x() >= 3 && p.y() >= 3 && p.x() < smoothed_.cols - 4 && p.y() < smoothed_.rows - 4;
}

Link Linker::arrival(int from, int side, const Vector2f& p, float gone) const {
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

}  // namespace servocal::board
