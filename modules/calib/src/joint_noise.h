// SPDX-License-Identifier: GPL-3.0-or-later
// How noisy corners and robot are: variance components of the joint solve.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "joint_problem.h"

namespace servocal::calib {

/// Covariance of the shared parameters and of what hangs on them.
class JointCovariance {
 public:
  /// `system` as linearized at the solution; its shared matrix must be regular.
  explicit JointCovariance(const ArrowSystem& system);
  const Eigen::MatrixXd& shared() const { return shared_; }
  Matrix6d ofStop(std::size_t stop) const;
  /// Shared by stop, size x 6.
  Eigen::MatrixXd crossOf(std::size_t stop) const;

 private:
  Eigen::MatrixXd shared_;
  std::vector<Eigen::Matrix<double, Eigen::Dynamic, 6>> gains_;  // cross * block^-1
  std::vector<Matrix6d> inverses_;
};

struct NoiseEstimate {
  JointNoise noise;
  double degrees_m = 0.0;
  double degrees_rad = 0.0;
  std::vector<double> chi_square;  ///< By camera, per degree of freedom, in units of claimed covariances.
};

/// One step of the iteration whose fixed point gives every group of observations a sum of squares equal to
/// its degrees of freedom: sigma^2 <- sum of squares / (count - trace of what the parameters take up).
///
/// Source: W. Förstner, 1979; the fixed point is that of restricted maximum likelihood.
NoiseEstimate varianceComponents(const JointProblem& problem, const JointState& state,
                                 const ArrowSystem& system);

/// A robust guess for the first rounds: per camera, the chi-square of its typical view.
std::vector<double> typicalCornerScales(const JointProblem& problem, const JointState& state);

/// Corners are not believed to be better than this many times what they claim, nor a robot beyond a
/// micrometre.
constexpr double kLeastCornerScale = 0.2;
constexpr double kLeastRobotSigma = 1e-6;
/// Where the estimate starts unless more is declared: a robot that is believed too much at first takes no
/// correction, and its error would pass for corner noise.
constexpr double kLooseRobotM = 1e-3;
constexpr double kLooseRobotRad = 2e-3;
/// Degrees of freedom that the estimate of a robot component takes; below, the declared noise is believed. The declared
/// priors of the robot's terms, of which there are few, count as so many themselves.
constexpr double kLeastDegrees = 6.0;

}  // namespace servocal::calib
