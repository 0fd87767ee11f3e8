// SPDX-License-Identifier: GPL-3.0-or-later
// How much a corner counts.
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "servocal/core/observation.h"

namespace servocal::calib {

/// Added to every claimed corner covariance: what image noise and gradient do not know of (print, bow,
/// pixel phase), so that no corner is believed beyond it.
constexpr double kCornerSigmaFloorPx = 0.03;
/// Of a corner whose covariance is not a finite positive matrix (a detector that claims none).
constexpr double kUnknownCornerSigmaPx = 0.2;

/// W with W^T W = covariance^-1: whitens the residual of a corner.
inline Eigen::Matrix2d whitening(const Corner& corner) {
  Eigen::Matrix2d covariance = corner.covariance_px2;
  const bool usable = covariance.allFinite() && covariance(0, 0) > 0.0 && covariance(1, 1) > 0.0 &&
                      covariance.determinant() > 0.0;
  if (!usable) return Eigen::Matrix2d::Identity() / kUnknownCornerSigmaPx;
  covariance.diagonal().array() += kCornerSigmaFloorPx * kCornerSigmaFloorPx;
  // Inverse of the lower Cholesky factor, written out: a = L L^T.
  const double l00 = std::sqrt(covariance(0, 0));
  const double l10 = covariance(1, 0) / l00;
  const double l11 = std::sqrt(covariance(1, 1) - l10 * l10);
  Eigen::Matrix2d root;
  root << 1.0 / l00, 0.0, -l10 / (l00 * l11), 1.0 / l11;
  return root;
}

}  // namespace servocal::calib
