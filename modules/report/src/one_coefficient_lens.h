// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "servocal/core/camera_model.h"

namespace servocal::report {

/// ViSP's perspective projection with distortion, and how far it is from the lens it stands for:
///   u = u0 + px x (1 + kud r2), r2 = x^2 + y^2, and, as its inverse,
///   x = (u - u0)/px (1 + kdu R2), R2 = ((u - u0)/px)^2 + ((v - v0)/py)^2.
///
/// Source: ViSP 3.5, vpCameraParameters.
struct OneCoefficientLens {
  double px = 0.0;
  double py = 0.0;
  double u0 = 0.0;
  double v0 = 0.0;
  double kud = 0.0;
  double kdu = 0.0;
  double forward_rms_px = 0.0;  ///< Length of the difference in the image, over the whole image,
  double forward_max_px = 0.0;
  double inverse_rms_px = 0.0;  ///< and of the difference of the rays, times the focal lengths.
  double inverse_max_px = 0.0;
};

/// The nearest model of this kind: least squares in the image over an even grid of the lens's own pixels,
/// first of px, py, u0, v0 and kud together, then of kdu for them.
/// @throws std::invalid_argument if the lens sees no pixel of its image.
OneCoefficientLens fitOneCoefficientLens(const CameraModel& lens);

}  // namespace servocal::report
