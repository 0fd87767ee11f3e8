// SPDX-License-Identifier: GPL-3.0-or-later
// What a stored calibration knows of a camera before the check looks.
#pragma once

#include <Eigen/Core>

#include "servocal/core/board_spec.h"
#include "servocal/core/result.h"

namespace servocal::procedure {

/// A hand-eye solution takes its intrinsics as exact: where they are off, the camera is put elsewhere to make
/// up for it, by several of its standard deviations. By how much per unit of each parameter: displacement of
/// the camera's origin and turn about it along the base's axes, times intrinsics (6 x p).
///
/// Of the solver's least squares, at views as a calibration takes them from `near_distance_m` on: of each
/// view's robot pose (6, `robot_sigma`), of camera and board (12) and of the intrinsics the first two are
/// eliminated.
Eigen::MatrixXd poseByIntrinsics(const BoardSpec& board, const CameraModel& camera,
                                 const HandEyeSolution& hand_eye, double near_distance_m,
                                 const Eigen::Matrix<double, 6, 1>& robot_sigma);

}  // namespace servocal::procedure
