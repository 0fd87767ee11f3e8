// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <gtest/gtest.h>

#include <iostream>

#include "calib_scene.h"
#include "servocal/calib/intrinsics.h"

namespace servocal::test {

/// The claimed standard deviations of the intrinsics are those of the answers over many draws of the noise.
inline void checkClaimedSpread(int seeds) {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(9), squares = sum, claimed = sum, z_squares = sum;
  std::mt19937_64 random(77);
  SceneOptions options;
  options.views = 20;
  const auto cMo = randomViews(hdCamera(), {}, options, random);
  Noise noise;
  noise.corner_px = 0.2;
  for (int seed = 0; seed < seeds; ++seed) {
    std::mt19937_64 draw(1000 + seed);
    const Scene scene = sceneOf(cMo, hdCamera(), {}, draw, Mount::kFixed, noise);
    const calib::IntrinsicsOutcome outcome =
        calib::solveIntrinsics(scene.board, scene.observations, kCamera, Stream::kColor);
    ASSERT_EQ(outcome.status, calib::IntrinsicsStatus::kSolved);
    const Eigen::VectorXd error = outcome.result->camera.parameters - scene.camera.parameters;
    sum += error;
    squares += error.cwiseAbs2();
    claimed += outcome.result->sigma.cwiseAbs2();
    z_squares += error.cwiseQuotient(outcome.result->sigma).cwiseAbs2();
  }
  for (int i = 0; i < 9; ++i) {
    const double spread = std::sqrt((squares[i] - sum[i] * sum[i] / seeds) / (seeds - 1));
    const double ratio = std::sqrt(claimed[i] / seeds) / spread;
    const std::string& name = parameterNames(LensModel::kPlumbBob)[i];
    std::cout << name << ": claimed / spread " << ratio << ", rms z " << std::sqrt(z_squares[i] / seeds) << '\n';
    EXPECT_GT(ratio, 0.8) << name;
    EXPECT_LT(ratio, 1.25) << name;
    // No bias beyond a third of the noise.
    EXPECT_LT(std::abs(sum[i] / seeds), 0.33 * spread + 3 * spread / std::sqrt(seeds)) << name;
  }
}

}  // namespace servocal::test
