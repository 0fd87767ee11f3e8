// SPDX-License-Identifier: GPL-3.0-or-later
// Random poses for tests, from a written seed.
#pragma once

#include <random>

#include "servocal/core/pose.h"

namespace servocal::test {

inline Eigen::Vector3d randomVector(std::mt19937_64& random, double half_range) {
  std::uniform_real_distribution<double> uniform(-half_range, half_range);
  const double x = uniform(random), y = uniform(random), z = uniform(random);
  return {x, y, z};
}

/// Rotation about a random axis by up to `max_angle_rad`, translation within +-`half_range_m` per axis.
template <class A, class B>
Pose<A, B> randomPose(std::mt19937_64& random, double max_angle_rad, double half_range_m) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> angle(0.0, max_angle_rad);
  Eigen::Vector3d axis(normal(random), normal(random), normal(random));
  const Eigen::Vector3d rotation = axis.normalized() * angle(random);
  return Pose<A, B>::fromRotationVector(rotation, randomVector(random, half_range_m));
}

}  // namespace servocal::test
