// SPDX-License-Identifier: GPL-3.0-or-later
// The part of a pose error that differs from visit to visit.
#pragma once

#include <Eigen/Geometry>
#include <array>

#include "random.h"

namespace servocal::sim {

/// A small rigid disturbance of the flange, a smooth random function of the joint path travelled so far:
/// constant while the arm stands, different whenever it comes back. A sum of cosines of random
/// frequencies approximates a Gaussian process (Rahimi & Recht, "Random Features for Large-Scale Kernel
/// Machines", 2007) and has the wanted root mean square exactly over a long path.
class Repeatability {
 public:
  /// RMS length of the position error and of the rotation vector.
  Repeatability(Random& random, double rms_m, double rms_rad);

  /// Disturbs bMe: shifts its origin and turns it about its origin.
  Eigen::Isometry3d apply(const Eigen::Isometry3d& bMe, double travelled_rad) const;

 private:
  static constexpr int kWaves = 24;
  struct Wave {
    double frequency = 0.0;
    double phase = 0.0;
  };
  double rms_m_;
  double rms_rad_;
  std::array<std::array<Wave, kWaves>, 6> waves_;
};

}  // namespace servocal::sim
