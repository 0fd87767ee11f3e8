// SPDX-License-Identifier: GPL-3.0-or-later
// Do the claims of the joint solve hold over many draws of the noise?
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <iostream>

#include "joint_scene.h"
#include "servocal/calib/joint.h"
#include "servocal/calib/uncertainty.h"

namespace servocal::test {

/// Quantile of the chi-square distribution by Wilson and Hilferty; z is the normal quantile.
inline double chiSquareQuantile(double degrees, double z) {
  const double a = 2.0 / (9.0 * degrees);
  return degrees * std::pow(1.0 - a + z * std::sqrt(a), 3);
}

struct SpreadCase {
  Mount mount = Mount::kFixed;
  int kinects = 1;
  int stops = 40;
  Noise noise{0.2, 1e-4, 2.5e-4};
  double declared_m = 1e-4;  ///< Robot noise that the solve is told.
  double declared_rad = 2.5e-4;
};

struct Spread {
  double chi_square = 0.0;  ///< Sum over the seeds of error' covariance^-1 error,
  int degrees = 0;          ///< which has this many degrees of freedom.
  std::vector<std::string> groups;
  std::vector<double> spread_over_claim;  ///< By group: intrinsics, poses, board pose, shape.
  std::vector<double> error_over_bound;   ///< RMS error over the Cramer-Rao bound.
};

/// One cell, the same stops, `seeds` draws of the noise.
inline Spread spreadOf(const SpreadCase& test, int seeds) {
  const Cell cell = makeCell(5, test.kinects, test.mount);
  std::mt19937_64 fixed(9);
  const std::vector<CellStop> stops = randomStops(cell, test.stops, fixed);
  calib::JointOptions options;
  options.mount = test.mount;
  options.robot_sigma_m = test.declared_m;
  options.robot_sigma_rad = test.declared_rad;
  Spread out;
  Eigen::VectorXd z_squares, bound_squares, claims, bound;
  std::vector<std::string> names;
  int shape_at = 0, board_at = 0;
  for (int seed = 0; seed < seeds; ++seed) {
    std::mt19937_64 random(4000 + seed);
    const auto observations = observeAll(cell, stops, test.noise, random);
    const calib::JointOutcome outcome = calib::solveJoint(cell.board, observations, options);
    EXPECT_EQ(outcome.status, calib::JointStatus::kSolved) << calib::toString(outcome.status);
    if (!outcome.solution) continue;
    const calib::JointSolution& solution = *outcome.solution;
    for (const calib::JointCamera& camera : solution.cameras) {
      for (const ViewResidual& view : camera.views) EXPECT_TRUE(view.used) << camera.camera << view.reason;
    }
    const Eigen::VectorXd errors = errorsOf(solution, cell);
    if (seed == 0) {
      names = solution.names;
      shape_at = solution.shape_at;
      board_at = solution.board_at;
      z_squares = bound_squares = Eigen::VectorXd::Zero(errors.size());
      bound = calib::jointCovarianceAt(cell.board, observations, truthLike(solution, cell, test.noise))
                  .diagonal()
                  .cwiseSqrt();
    }
    out.chi_square += errors.dot(solution.covariance.ldlt().solve(errors));
    out.degrees += static_cast<int>(errors.size());
    z_squares += errors.cwiseQuotient(solution.sigma).cwiseAbs2() / seeds;
    bound_squares += errors.cwiseQuotient(bound).cwiseAbs2() / seeds;
  }
  const auto group = [&](const std::string& name, const auto& belongs) {
    double z = 0, b = 0;
    int count = 0;
    for (int i = 0; i < static_cast<int>(names.size()); ++i) {
      if (!belongs(i)) continue;
      z += z_squares[i];
      b += bound_squares[i];
      ++count;
    }
    out.groups.push_back(name);
    out.spread_over_claim.push_back(std::sqrt(z / count));
    out.error_over_bound.push_back(std::sqrt(b / count));
  };
  const auto is_pose = [&](int i) {
    const std::string& name = names[static_cast<std::size_t>(i)];
    return name.back() == 'x' || name.back() == 'y' || name.back() == 'z';
  };
  const auto is_lens = [&](int i) {
    const std::string& name = names[static_cast<std::size_t>(i)];
    return i < board_at &&
           (!is_pose(i) || name.find(" fx") != std::string::npos || name.find(" fy") != std::string::npos ||
            name.find(" cx") != std::string::npos || name.find(" cy") != std::string::npos);
  };
  group("intrinsics", is_lens);
  group("camera poses", [&](int i) { return i < board_at && !is_lens(i); });
  group("board pose", [&](int i) { return i >= board_at && i < shape_at; });
  group("board shape", [&](int i) { return i >= shape_at; });
  std::cout << seeds << " seeds: chi-square " << out.chi_square << " of " << out.degrees << '\n';
  for (std::size_t g = 0; g < out.groups.size(); ++g) {
    std::cout << "  " << out.groups[g] << ": spread / claim " << out.spread_over_claim[g]
              << ", error / bound " << out.error_over_bound[g] << '\n';
  }
  return out;
}

}  // namespace servocal::test
