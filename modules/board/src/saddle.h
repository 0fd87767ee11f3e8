// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace servocal::board {

/// A place where two black and two white sectors meet, in pixels of the image it was found in.
struct Saddle {
  Eigen::Vector2f pixel;
  /// Unit vectors along the four edges that leave the point, by increasing angle from x towards y.
  std::array<Eigen::Vector2f, 4> rays;
  /// +1 if it is brighter on the side of rays[0] towards rays[1]; -1 otherwise. Sides alternate by ray.
  int side = 1;
  float contrast = 0.0f;  ///< Brightest minus darkest around the point, in units of smooth(), 16 per gray level.
  int response = 0;

  /// Side of ray k: the sign of the brightness step from its right to its left, left being +90 degrees
  /// from x towards y.
  int raySide(int k) const { return (k & 1) ? -side : side; }
};

/// The image smoothed with a 3 x 3 binomial, 16 units per gray level (CV_16SC1).
cv::Mat smooth(const cv::Mat& gray);

/// Saddle points of a smoothed image: local maxima of minus the Hessian's determinant, which unlike a
/// ring of samples alone still responds when perspective has closed the angle between the edges, and
/// then verified on a ring: opposite samples agree, and brightness alternates over four sectors.
///
/// Source for the ring's symmetry: Bennett & Lasenby, "ChESS - Quick and robust detection of chess-board
/// features", Computer Vision and Image Understanding 118, 2014, section 3.
std::vector<Saddle> findSaddles(const cv::Mat& smoothed);

}  // namespace servocal::board
