// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "place_index.h"

namespace servocal::board {

/// Brightness between pixels of a smoothed image.
inline float sample(const cv::Mat& smoothed, const Eigen::Vector2f& p) {
  const int x = static_cast<int>(p.x());
  const int y = static_cast<int>(p.y());
  const float fx = p.x() - x;
  const float fy = p.y() - y;
  const short* a = smoothed.ptr<short>(y) + x;
  const short* b = smoothed.ptr<short>(y + 1) + x;
  return (1 - fy) * ((1 - fx) * a[0] + fx * a[1]) + fy * ((1 - fx) * b[0] + fx * b[1]);
}

/// Where an edge leads.
struct Link {
  int node = -1;
  int ray = 0;  ///< The ray of `node` that points back.
};

/// Follows edges from saddle point to saddle point.
class Linker {
 public:
  Linker(const cv::Mat& smoothed, const std::vector<Saddle>& saddles, float longest_px)
      : smoothed_(smoothed), saddles_(saddles), index_(smoothed.size(), saddles), longest_px_(longest_px) {}

  /// Follows ray k of saddle `from` until the next saddle point, or until the edge ends or is too long.
  Link follow(int from, int k) const;

 private:
  bool inside(const Eigen::Vector2f& p) const;
  Link arrival(int from, int side, const Eigen::Vector2f& p, float gone) const;

  const cv::Mat& smoothed_;
  const std::vector<Saddle>& saddles_;
  PlaceIndex index_;
  float longest_px_;
};

}  // namespace servocal::board
