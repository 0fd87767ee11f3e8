// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/depth_distortion.h"

#include <gtest/gtest.h>

#include "depth_scene.h"

namespace servocal::calib {
namespace {

using test::DepthScene;

test::SceneOptions cellViews(int views) {
  test::SceneOptions options;
  options.views = views;
  options.near_m = 0.55;
  options.far_m = 1.1;
  return options;
}

DepthOutcome solve(const DepthScene& scene, const DepthOptions& options = {}) {
  return solveDepth(scene.board, scene.truth.camera, scene.observations, test::kCamera, scene.truth.sensor, options);
}

class SolveDepth : public testing::TestWithParam<DepthSensor> {
 protected:
  DepthModel truth() const {
    return GetParam() == DepthSensor::kTimeOfFlight ? test::timeOfFlight() : test::structuredLight();
  }
};

TEST_P(SolveDepth, RecoversTruthFromNoiselessViews) {
  const DepthScene scene = test::makeDepthScene(1, truth(), cellViews(60));
  const DepthOutcome outcome = solve(scene);
  ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
  EXPECT_TRUE(outcome.left_out.empty());
  EXPECT_LT(test::correctionError(outcome.result->model, scene.truth, 0.6, 1.1), 2e-5);
  EXPECT_GT(outcome.result->rms_before_m, 0.005);
  EXPECT_LT(outcome.result->rms_after_m, 1e-5);
  // The measure does see the distortion.
  DepthModel none = scene.truth;
  none.offset = 0.0, none.slope = 1.0, none.nodes.setZero();
  EXPECT_GT(test::correctionError(none, scene.truth, 0.6, 1.1), 0.004);
}

TEST_P(SolveDepth, MeetsTheTargetWithRealisticNoise) {
  const double target_m = GetParam() == DepthSensor::kTimeOfFlight ? 0.003 : 0.004;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const DepthScene scene = test::makeDepthScene(seed, truth(), cellViews(40), {0.15, 4e-4, 6e-4});
    const DepthOutcome outcome = solve(scene);
    ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
    const double error = test::correctionError(outcome.result->model, scene.truth, 0.6, 1.1);
    std::cout << "seed " << seed << ": " << 1e3 * error << " mm\n";
    EXPECT_LT(error, target_m) << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Sensors, SolveDepth,
                         testing::Values(DepthSensor::kTimeOfFlight, DepthSensor::kStructuredLight),
                         [](const auto& info) { return std::string(info.param == DepthSensor::kTimeOfFlight
                                                                       ? "TimeOfFlight" : "StructuredLight"); });

}  // namespace
}  // namespace servocal::calib
