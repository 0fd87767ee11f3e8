// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <visp3/core/vpColVector.h>
#include <visp3/core/vpHomogeneousMatrix.h>

#include <stdexcept>

#include "servocal/core/pose.h"

/// The only conversion between our types and ViSP's. Frames keep their letters: `Pose<A, B> aMb` is
/// ViSP's `aMb`. Part of the target servocal::core_visp; nothing else includes ViSP's types.
namespace servocal {

template <class A, class B>
vpHomogeneousMatrix toVisp(const Pose<A, B>& aMb) {
  vpHomogeneousMatrix result;
  for (unsigned row = 0; row < 3; ++row)
    for (unsigned column = 0; column < 4; ++column)
      result[row][column] = aMb.isometry().matrix()(row, column);
  return result;
}

/// The caller names the frames: `fromVisp<Color, Board>(cMo)`.
template <class A, class B>
Pose<A, B> fromVisp(const vpHomogeneousMatrix& aMb) {
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  for (unsigned row = 0; row < 3; ++row)
    for (unsigned column = 0; column < 4; ++column) result.matrix()(row, column) = aMb[row][column];
  return Pose<A, B>(result);
}

/// vx vy vz wx wy wz, as ViSP's velocity vectors.
template <class F>
vpColVector toVisp(const Twist<F>& twist) {
  vpColVector result(6);
  for (unsigned axis = 0; axis < 3; ++axis) {
    result[axis] = twist.linear_mps[axis];
    result[axis + 3] = twist.angular_radps[axis];
  }
  return result;
}

/// @throws std::invalid_argument unless the vector has six entries.
template <class F>
Twist<F> twistFromVisp(const vpColVector& velocity) {
  if (velocity.size() != 6) throw std::invalid_argument("a velocity vector has six entries");
  Twist<F> result;
  for (unsigned axis = 0; axis < 3; ++axis) {
    result.linear_mps[axis] = velocity[axis];
    result.angular_radps[axis] = velocity[axis + 3];
  }
  return result;
}

}  // namespace servocal
