// SPDX-License-Identifier: GPL-3.0-or-later
// Least squares whose normal matrix is an arrow: a few shared parameters (a camera model; two hand-eye
// poses) and six parameters of each view (its board pose; its robot-pose correction).
//
// Own code instead of Ceres because the covariance of the shared parameters is the inverse of the very
// Schur complement that gives the step, and because a solve of 80 views costs a few milliseconds.
#pragma once

#include <Eigen/Core>
#include <Eigen/StdVector>
#include <cmath>
#include <optional>
#include <vector>

#include "se3.h"

namespace servocal::calib {

/// Normal equations at one state, unscaled: the residual's sum of squares is `cost`, its half gradient
/// `gradient`, its Gauss-Newton matrix `matrix`.
struct ArrowSystem {
  struct Block {
    Matrix6d matrix = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    Eigen::Matrix<double, Eigen::Dynamic, 6> cross;  ///< Shared rows by the block's columns.
  };

  ArrowSystem(int shared_size, int block_count);
  /// Adds one view's residuals. `jacobian` has the shared columns first, then the block's six.
  void add(int block, const Eigen::MatrixXd& jacobian, const Eigen::VectorXd& residual);

  Eigen::MatrixXd matrix;
  Eigen::VectorXd gradient;
  std::vector<Block> blocks;
  double cost = 0.0;
};

struct ArrowStep {
  Eigen::VectorXd shared;
  std::vector<Vector6d> blocks;
  double decrement = 0.0;  ///< Decrease of the cost that the quadratic model predicts.
};

/// Gauss-Newton step with the diagonal enlarged by the factor 1 + damping (Marquardt's scaling).
/// Nothing if the damped matrix is not positive definite.
std::optional<ArrowStep> arrowStep(const ArrowSystem& system, double damping);

/// Information of the shared parameters with the blocks eliminated.
Eigen::MatrixXd reducedMatrix(const ArrowSystem& system);

/// Ratio of the extreme eigenvalues of a symmetric matrix; infinite if it is not positive definite.
double symmetricCondition(const Eigen::MatrixXd& matrix);
/// The same of the matrix scaled to unit diagonal.
double scaledCondition(const Eigen::MatrixXd& matrix);

/// Inverse of a positive definite matrix, computed on its unit-diagonal scaling.
Eigen::MatrixXd scaledInverse(const Eigen::MatrixXd& matrix);

template <class State>
struct ArrowFit {
  State state;
  ArrowSystem system;  ///< Linearized at `state`.
  bool converged = false;
  int iterations = 0;
};

/// Levenberg-Marquardt down to rounding, so that the answer does not depend on where it started.
///
/// `linearize(state)` gives an optional<ArrowSystem>, nothing where the model is undefined (a point
/// behind the camera); `move(state, step)` the moved state. Nothing if even the start is undefined.
///
/// Source: D. Marquardt, "An Algorithm for Least-Squares Estimation of Nonlinear Parameters", 1963.
template <class State, class Linearize, class Move>
std::optional<ArrowFit<State>> minimizeArrow(const State& start, const Linearize& linearize,
                                             const Move& move, int max_iterations = 100,
                                             double tolerance = 1e-18) {
  std::optional<ArrowSystem> system = linearize(start);
  if (!system || !std::isfinite(system->cost)) return std::nullopt;
  ArrowFit<State> fit{start, *std::move(system), false, 0};
  double damping = 1e-4;
  double last_decrement = INFINITY;
  for (; fit.iterations < max_iterations; ++fit.iterations) {
    const std::optional<ArrowStep> step = arrowStep(fit.system, damping);
    std::optional<ArrowSystem> trial;
    std::optional<State> next;
    if (step) {
      // 1e-24: noiseless input, where the cost itself goes to zero.
      if (damping < 1e-3 && step->decrement <= tolerance * fit.system.cost + 1e-24) {
        fit.converged = true;
        break;
      }
      next = move(fit.state, *step);
      trial = linearize(*next);
    }
    // Rounding makes the last steps look like tiny increases.
    if (trial && trial->cost <= fit.system.cost * (1.0 + 1e-12) + 1e-24) {
      const bool at_rounding = damping < 1e-3 && step->decrement < 1e-12 * fit.system.cost + 1e-22 &&
                               step->decrement > 0.25 * last_decrement;
      last_decrement = step->decrement;
      fit.state = *std::move(next);
      fit.system = *std::move(trial);
      damping = damping < 1e-9 ? 0.0 : damping * 0.1;
      if (at_rounding) {
        fit.converged = true;
        break;
      }
    } else {
      damping = std::max(damping * 10.0, 1e-6);
      last_decrement = INFINITY;
      if (damping > 1e12) {
        // No direction leads down any more although the model predicts it: rounding, if it predicts
        // next to nothing; otherwise a wall of the model, which is not a minimum.
        const std::optional<ArrowStep> free = arrowStep(fit.system, 1e-9);
        fit.converged = free && free->decrement < 1e-9 * fit.system.cost + 1e-20;
        break;
      }
    }
  }
  return fit;
}

}  // namespace servocal::calib
