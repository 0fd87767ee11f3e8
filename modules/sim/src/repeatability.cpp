// SPDX-License-Identifier: GPL-3.0-or-later
#include "repeatability.h"

namespace servocal::sim {
namespace {

constexpr double kCorrelationRad = 0.1;  // Joint path after which the error is another one.

}  // namespace

Repeatability::Repeatability(Random& random, double rms_m, double rms_rad)
    : rms_m_(rms_m), rms_rad_(rms_rad) {
  for (auto& axis : waves_) {
    for (Wave& wave : axis) {
      wave = {random.normal() / kCorrelationRad, random.uniform(0.0, 2.0 * M_PI)};
    }
  }
}

Eigen::Isometry3d Repeatability::apply(const Eigen::Isometry3d& bMe, double travelled_rad) const {
  Eigen::Matrix<double, 6, 1> value;  // Unit RMS length of each half.
  for (int axis = 0; axis < 6; ++axis) {
    double sum = 0.0;
    for (const Wave& wave : waves_[axis]) sum += std::cos(wave.frequency * travelled_rad + wave.phase);
    value[axis] = sum * std::sqrt(2.0 / kWaves / 3.0);
  }
  const Eigen::Vector3d turn = rms_rad_ * value.tail<3>();
  Eigen::Isometry3d disturbed = bMe;
  if (turn.norm() > 0.0) {
    disturbed.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()) * bMe.linear();
  }
  disturbed.translation() += rms_m_ * value.head<3>();
  return disturbed;
}

}  // namespace servocal::sim
