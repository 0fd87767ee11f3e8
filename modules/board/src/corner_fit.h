// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace servocal::board {

/// What is known of a corner before its position is refined.
struct CornerGuess {
  Eigen::Vector2d pixel;
  /// Pixels per square along u (first column) and v (second): directions of the two edges, and spacing.
  Eigen::Matrix2d axes;
  /// Blur across the edges along u and along v: standard deviation of the point spread, px.
  Eigen::Vector2d blur_px = {1.0, 1.0};
  bool fit_blur = true;
  /// Curvature of the edges along u and along v, towards growing v and growing u, 1/px: what a lens bends.
  Eigen::Vector2d bend = {0.0, 0.0};
  /// Quadrant (signs of u and v) that holds the hollow square, whose white inside starts
  /// `hollow_start` squares from the corner; (0,0): none.
  Eigen::Vector2i hollow_quadrant = {0, 0};
  double hollow_start = 0.2;
  bool hollow_opposite = false;  ///< The opposite quadrant holds one too (the markers of a ChArUco board).
};

/// A corner as measured.
struct CornerFit {
  Eigen::Vector2d pixel;
  Eigen::Matrix2d structure;  ///< Inverse of the covariance at unit image noise, 1/px^2.
  double step = 0.0;          ///< Brightness: > 0 if brighter where u and v grow together.
  double residual = 0.0;      ///< RMS over the pixels used, gray levels.
  Eigen::Vector2d blur_px;    ///< Across the edges along u and along v; as given if it was not to be fitted.
  int pixels = 0;
};

/// Fits the picture of a blurred corner, brightness = level + step * erf(d1) * erf(d2) with d1, d2 the distances from
/// its two edges in units of blur; for edges that are not at right angles, with the terms that the blur they share adds.
/// Level and step change linearly across the window, as light does, and what is brighter than white is cut off.
///
/// The window is a parallelogram along the projected squares, so it takes in as much of the two edges as it can without
/// touching the next ones. Point symmetry makes the position blind to errors of blur and level. Nothing if the window
/// leaves the image or the fit does not converge near the guess.
std::optional<CornerFit> fitCorner(const cv::Mat& gray, const CornerGuess& guess);

}  // namespace servocal::board
