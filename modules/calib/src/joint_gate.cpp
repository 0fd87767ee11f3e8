// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_gate.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "median.h"

namespace servocal::calib {
namespace {

/// How one view fits.
struct Fit {
  double scale = INFINITY;       // square root of its robust chi-square per residual
  double correction = INFINITY;  // of its stop, in standard deviations of the robot
};

Vector6d robotRoot(const JointNoise& noise) {
  Vector6d root;
  root << Eigen::Vector3d::Constant(1.0 / noise.robot_m), Eigen::Vector3d::Constant(1.0 / noise.robot_rad);
  return root;
}

double scaleOf(const JointResidual& seen) {
  return std::sqrt((seen.residual.squaredNorm() + seen.robust_excess) /
                   static_cast<double>(seen.residual.size()));
}

/// The view as the state has it.
Fit fitOf(const JointProblem& problem, const JointState& state, const JointView& view) {
  const auto seen = problem.residual(state, view);
  if (!seen) return {};
  return {scaleOf(*seen), robotRoot(problem.noise()).cwiseProduct(state.corrections[view.stop]).norm()};
}

/// The view with a correction of its own, the other cameras at its stop unheard.
Fit fitAlone(const JointProblem& problem, JointState state, const JointView& view) {
  const Vector6d root = robotRoot(problem.noise());
  Vector6d& correction = state.corrections[view.stop];
  correction.setZero();
  Fit best;
  for (int round = 0; round < 8; ++round) {
    const auto seen = problem.residual(state, view);
    if (!seen) return best;
    best = {scaleOf(*seen), root.cwiseProduct(correction).norm()};
    const auto own = seen->jacobian.rightCols<6>();
    Matrix6d matrix = own.transpose() * own;
    matrix += Matrix6d(root.cwiseAbs2().asDiagonal());
    const Vector6d gradient = own.transpose() * seen->residual + root.cwiseAbs2().cwiseProduct(correction);
    const Vector6d step = matrix.ldlt().solve(gradient);
    correction -= step;
    if (root.cwiseProduct(step).norm() < 0.01) break;
  }
  return best;
}

}  // namespace

std::vector<bool> judgeViews(const JointProblem& problem, const JointState& state,
                             const std::vector<JointViewStart>& views) {
  std::vector<Fit> fits;
  std::vector<std::vector<double>> by_camera(problem.layout().cameras.size());
  std::vector<double> corrections;
  for (const JointViewStart& start : views) {
    const JointView& view = start.view;
    fits.push_back(start.used ? fitOf(problem, state, view) : fitAlone(problem, state, view));
    if (!start.used) continue;
    by_camera[view.camera].push_back(fits.back().scale);
    corrections.push_back(fits.back().correction);
  }
  // As in the hand-eye: twice the typical view, six standard deviations of the views as they scatter; at
  // least what chance does to a chi-square of this many degrees. Below one only in noiseless input: no
  // outliers.
  std::vector<double> middle, spread;
  for (const std::vector<double>& scales : by_camera) {
    middle.push_back(scales.empty() ? 1.0 : std::max(1.0, median(scales)));
    std::vector<double> deviations = {0.0};
    for (const double scale : scales) deviations.push_back(std::abs(scale - middle.back()));
    spread.push_back(1.4826 * median(deviations));
  }
  const double correction_limit = std::max(8.0, 4.0 * (corrections.empty() ? 0.0 : median(corrections)));
  const auto limitOf = [&](const JointView& view) {
    const double m = middle[view.camera], degrees = 2.0 * static_cast<double>(view.weights.size());
    return std::max({2.0 * m, m + 6.0 * spread[view.camera], m * (1.0 + 4.0 / std::sqrt(degrees))});
  };
  const auto fine = [&](const Fit& fit, const JointView& view, double share) {
    return fit.scale <= share * limitOf(view) && fit.correction <= share * correction_limit;
  };

  std::vector<bool> stays(views.size());
  for (std::size_t begin = 0; begin < views.size();) {
    std::size_t end = begin;
    int heard = 0;
    bool all_fine = true;
    for (; end < views.size() && views[end].view.stop == views[begin].view.stop; ++end) {
      heard += views[end].used ? 1 : 0;
      all_fine = all_fine && (!views[end].used || fine(fits[end], views[end].view, 1.0));
    }
    for (std::size_t i = begin; i < end; ++i) {
      const JointView& view = views[i].view;
      if (!views[i].used) {
        // What the image itself spoke against stays out.
        stays[i] = views[i].cause == ViewCause::kNone && fine(fits[i], view, 0.7);
      } else if (all_fine || heard == 1) {
        stays[i] = fine(fits[i], view, 1.0);
      } else {
        stays[i] = fine(fitAlone(problem, state, view), view, 1.0);
      }
    }
    // Each fits the robot alone, and they contradict each other: the worst goes.
    const auto left = std::count(stays.begin() + static_cast<std::ptrdiff_t>(begin),
                                 stays.begin() + static_cast<std::ptrdiff_t>(end), true);
    if (!all_fine && heard > 1 && left == heard) {
      std::size_t worst = begin;
      for (std::size_t i = begin; i < end; ++i) {
        if (views[i].used && (!views[worst].used || fits[i].scale > fits[worst].scale)) worst = i;
      }
      stays[worst] = false;
    }
    begin = end;
  }
  return stays;
}

}  // namespace servocal::calib
