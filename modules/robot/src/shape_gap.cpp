// SPDX-License-Identifier: GPL-3.0-or-later
#include "shape_gap.h"

#include <fcl/geometry/shape/box.h>
#include <fcl/narrowphase/distance.h>

#include <algorithm>
#include <cmath>

namespace servocal::robot {
namespace {

constexpr double kFarM = 0.1;
constexpr double kOverlapM = 1e-3;  // Reported for two boxes that overlap, however deep.

// Source: C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.9 (segments around their middles).
double betweenAxes(const RoundedBox& a, const Eigen::Isometry3d& a_pose, const RoundedBox& b,
                   const Eigen::Isometry3d& b_pose) {
  const Eigen::Vector3d along_a = a_pose.linear().col(2), along_b = b_pose.linear().col(2);
  const Eigen::Vector3d apart = a_pose.translation() - b_pose.translation();
  const double half_a = a.half_m.z(), half_b = b.half_m.z();
  const double cosine = along_a.dot(along_b), on_a = along_a.dot(apart), on_b = along_b.dot(apart);
  const double squared_sine = 1.0 - cosine * cosine;
  double s = squared_sine > 1e-12 ? std::clamp((cosine * on_b - on_a) / squared_sine, -half_a, half_a) : 0.0;
  const double t = std::clamp(cosine * s + on_b, -half_b, half_b);
  s = std::clamp(cosine * t - on_a, -half_a, half_a);
  return (apart + s * along_a - t * along_b).norm();
}

double signedDistance(const Eigen::Vector3d& half, const Eigen::Vector3d& point) {
  const Eigen::Vector3d outside = point.cwiseAbs() - half;
  const double most = outside.maxCoeff();
  return most <= 0.0 ? most : outside.cwiseMax(0.0).norm();
}

double axisToBox(const RoundedBox& axis, const Eigen::Isometry3d& axis_pose, const RoundedBox& box,
                 const Eigen::Isometry3d& box_pose) {
  const Eigen::Isometry3d seen = box_pose.inverse(Eigen::Isometry) * axis_pose;
  const Eigen::Vector3d middle = seen.translation(), along = seen.linear().col(2);
  const auto at = [&](double t) { return signedDistance(box.half_m, middle + t * along); };
  double low = -axis.half_m.z(), high = axis.half_m.z();
  constexpr double kGolden = 0.6180339887498949;
  double left = high - kGolden * (high - low), right = low + kGolden * (high - low);
  double at_left = at(left), at_right = at(right);
  double least = std::min({at(low), at(high), at_left, at_right});
  while (high - low > 1e-6) {
    if (at_left < at_right) {
      high = right, right = left, at_right = at_left;
      left = high - kGolden * (high - low);
      at_left = at(left);
    } else {
      low = left, left = right, at_left = at_right;
      right = low + kGolden * (high - low);
      at_right = at(right);
    }
    least = std::min({least, at_left, at_right});
  }
  return least;
}

double betweenBoxes(const RoundedBox& a, const Eigen::Isometry3d& a_pose, const RoundedBox& b,
                    const Eigen::Isometry3d& b_pose) {
  const fcl::Boxd one(2.0 * a.half_m), other(2.0 * b.half_m);
  fcl::DistanceResultd result;
  fcl::distance(&one, a_pose, &other, b_pose, fcl::DistanceRequestd(), result);
  return result.min_distance > 0.0 ? result.min_distance : -kOverlapM;
}

}  // namespace

double gap(const RoundedBox& a, const Eigen::Isometry3d& a_pose, const RoundedBox& b,
           const Eigen::Isometry3d& b_pose) {
  const double radii = a.radius_m + b.radius_m;
  const double bound =
      (a_pose.translation() - b_pose.translation()).norm() - a.half_m.norm() - b.half_m.norm() - radii;
  if (bound > kFarM) return bound;
  if (a.isBox() && b.isBox()) return betweenBoxes(a, a_pose, b, b_pose) - radii;
  if (a.isBox()) return axisToBox(b, b_pose, a, a_pose) - radii;
  if (b.isBox()) return axisToBox(a, a_pose, b, b_pose) - radii;
  return betweenAxes(a, a_pose, b, b_pose) - radii;
}

}  // namespace servocal::robot
