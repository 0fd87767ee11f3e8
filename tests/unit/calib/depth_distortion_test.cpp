// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/depth_distortion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

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
  const DepthScene scene = test::makeDepthScene(1, truth(), cellViews(150));  // all over the image
  DepthOptions options;
  for (std::size_t i = 0; i < scene.observations.size(); ++i) {
    options.board_poses.emplace(scene.observations[i].id, relabel<Infrared, Board>(scene.cell.cMo[i]));
  }
  options.board_pose_sigma_m = options.board_pose_sigma_rad = 1e-7;
  const DepthOutcome outcome = solve(scene, options);
  ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
  EXPECT_TRUE(outcome.left_out.empty());
  EXPECT_LT(test::correctionError(outcome.result->model, scene.truth, 0.6, 1.1), 1e-6);
  EXPECT_LT(outcome.result->rms_after_m, 1e-6);
  // From the corners alone, each believed to 0.1 px, the lattice is held a little smoother than it is.
  EXPECT_LT(test::correctionError(solve(scene).result->model, scene.truth, 0.6, 1.1), 5e-5);
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

TEST_P(SolveDepth, NamesViewsThatContradictTheOthers) {
  DepthScene scene = test::makeDepthScene(3, truth(), cellViews(30), {0.15, 4e-4, 6e-4});
  // Something else was in front (30 mm), a board that was moving (tilted depth), a flip of the sensor's phase.
  for (DepthPatch& patch : scene.observations[4].views[0].depth->patches) patch.depth_m += 0.03;
  for (DepthPatch& patch : scene.observations[11].views[0].depth->patches) {
    patch.depth_m += 0.0006 * (patch.pixel.x() - scene.truth.camera.cx());
  }
  for (DepthPatch& patch : scene.observations[20].views[0].depth->patches) patch.depth_m *= 1.4;
  const DepthOutcome outcome = solve(scene);
  ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
  EXPECT_EQ(outcome.left_out, (std::vector<std::int64_t>{5, 12, 21}));
  EXPECT_LT(test::correctionError(outcome.result->model, scene.truth, 0.6, 1.1), 0.0015);
}

// Most stops of a run are in the middle of the image, and their boards' places are known to a tenth of a millimetre.
// Views elsewhere, where the sensor errs otherwise, are no contradiction: not if they are many, nor if it errs by much.
TEST_P(SolveDepth, KeepsTheViewsWhereTheSensorErrsOtherwise) {
  for (const auto& [times, most_elsewhere] : {std::pair(2.5, 15), std::pair(6.0, 10)}) {
    DepthModel wavy = truth();
    wavy.nodes *= times;
    DepthScene scene = test::makeDepthScene(6, wavy, cellViews(500), {0.15, 4e-4, 0.0});
    DepthOptions options;
    options.board_pose_sigma_m = options.board_pose_sigma_rad = 1e-4;
    std::vector<Observation> chosen;
    int middle = 0, elsewhere = 0;
    for (std::size_t i = 0; i < scene.observations.size(); ++i) {
      const Pose<Color, Board>& cMo = scene.cell.cMo[i];
      const bool is_middle = cMo.translation().hnormalized().norm() < 0.15;
      if (is_middle ? middle++ >= 25 : elsewhere++ >= most_elsewhere) continue;
      options.board_poses.emplace(scene.observations[i].id, relabel<Infrared, Board>(cMo));
      chosen.push_back(scene.observations[i]);
    }
    ASSERT_EQ(chosen.size(), 25u + static_cast<std::size_t>(most_elsewhere));
    scene.observations = chosen;
    const DepthOutcome outcome = solve(scene, options);
    ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
    EXPECT_TRUE(outcome.left_out.empty()) << outcome.left_out.size() << " of " << chosen.size() << ", " << times;
  }
}

TEST_P(SolveDepth, OneDistanceLeavesTheSlopeAlone) {
  test::SceneOptions options = cellViews(30);
  options.near_m = options.far_m = 0.75;
  const DepthScene scene = test::makeDepthScene(4, truth(), options, {0.15, 4e-4, 6e-4});
  const DepthOutcome outcome = solve(scene);
  ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
  EXPECT_EQ(outcome.result->model.slope, 1.0);
  ASSERT_FALSE(outcome.result->notes.empty());
  EXPECT_NE(outcome.result->notes[0].find("one distance"), std::string::npos);
  EXPECT_LT(test::correctionError(outcome.result->model, scene.truth, 0.74, 0.76), 0.003);
}

TEST_P(SolveDepth, SaysWhereNoBoardWas) {
  DepthScene scene = test::makeDepthScene(5, truth(), cellViews(60), {0.15, 4e-4, 6e-4});
  for (Observation& observation : scene.observations) {
    auto& patches = observation.views[0].depth->patches;
    const double middle = scene.truth.camera.cx();
    patches.erase(std::remove_if(patches.begin(), patches.end(),
                                 [&](const DepthPatch& patch) { return patch.pixel.x() > middle; }),
                  patches.end());
  }
  const DepthOutcome outcome = solve(scene);
  ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
  ASSERT_EQ(outcome.result->notes.size(), 1u);
  EXPECT_NE(outcome.result->notes[0].find("no board was seen in"), std::string::npos);
}

TEST_P(SolveDepth, SigmasAreTheSpread) {
  test::SceneOptions options = cellViews(25);
  constexpr int kSeeds = 30;
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  const DepthModel truth = this->truth();
  const Eigen::Vector2d middle(0.5 * (truth.camera.width_px - 1), 0.5 * (truth.camera.height_px - 1));
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const DepthScene scene = test::makeDepthScene(100 + seed, truth, options, {0.15, 4e-4, 6e-4});
    const DepthOutcome outcome = solve(scene);
    ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
    for (int k = 0; k < 3; ++k) {  // near, middle, far of what was visited
      const double raw = outcome.result->sigma_at_m[k];
      const double error = *outcome.result->model.correct(middle, raw) - *truth.correct(middle, raw);
      squares[k] += std::pow(error / outcome.result->sigma_m[k], 2) / kSeeds;
    }
  }
  std::cout << "mean squared z, near middle far: " << squares.transpose() << '\n';
  // Chi-square of 30: within four of its deviations.
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(squares[k], 1.0, 4.0 * std::sqrt(2.0 / kSeeds)) << k;
  for (int k = 0; k < 3; ++k) EXPECT_GT(squares[k], 0.3) << k;
}

/// Views whose board poses are known to 0.2 mm, as robot and images together know them.
DepthOutcome solveKnowingTheBoards(DepthScene scene, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  DepthOptions options;
  options.board_pose_sigma_m = 2e-4;
  options.board_pose_sigma_rad = 2e-4;
  for (std::size_t i = 0; i < scene.observations.size(); ++i) {
    const auto disturbed = test::disturbed(scene.cell.cMo[i], random, 2e-4, 2e-4);
    options.board_poses.emplace(scene.observations[i].id, relabel<Infrared, Board>(disturbed));
  }
  return solve(scene, options);
}

TEST(SolveDepthOfTimeOfFlight, FollowsTheWiggle) {
  double squares_m2 = 0.0, straight_m2 = 0.0, squares_z = 0.0;
  constexpr int kSeeds = 8;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const DepthScene scene =
        test::makeDepthScene(seed, test::wigglingTimeOfFlight(), cellViews(60), {0.15, 4e-4, 1e-4});
    const DepthOutcome outcome = solveKnowingTheBoards(scene, seed);
    ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
    const DepthModel& model = outcome.result->model;
    ASSERT_GT(model.wiggle.size(), 0);
    squares_m2 += std::pow(test::correctionError(model, scene.truth, 0.6, 1.05), 2) / kSeeds;
    DepthModel straight = model;  // The line through it where the boards were.
    Eigen::MatrixXd line(20, 2);
    Eigen::VectorXd along(20);
    for (int k = 0; k < 20; ++k) {
      line.row(k) << 1.0, 0.55 + 0.03 * k;
      along[k] = model.wiggling(0.55 + 0.03 * k);
    }
    const Eigen::Vector2d through = line.colPivHouseholderQr().solve(along);
    straight.offset += through[0], straight.slope += through[1], straight.wiggle.resize(0);
    straight_m2 += std::pow(test::correctionError(straight, scene.truth, 0.6, 1.05), 2) / kSeeds;
    const Eigen::Vector2d middle(0.5 * 511, 0.5 * 423);
    for (Eigen::Index k = 0; k < 3; ++k) {
      const double raw_m = outcome.result->sigma_at_m[k];
      const double error_m = *model.correct(middle, raw_m) - *scene.truth.correct(middle, raw_m);
      squares_z += std::pow(error_m / outcome.result->sigma_m[k], 2) / (3 * kSeeds);
    }
  }
  std::cout << "error " << 1e3 * std::sqrt(squares_m2) << " mm, without the wiggle " << 1e3 * std::sqrt(straight_m2)
            << " mm, over claim " << std::sqrt(squares_z) << '\n';
  EXPECT_LT(std::sqrt(squares_m2), 3.5e-4);  // Of which most is the lattice.
  EXPECT_LT(std::sqrt(squares_m2), 0.75 * std::sqrt(straight_m2));
  EXPECT_LT(std::sqrt(squares_z), 1.5);
}

TEST(SolveDepthOfTimeOfFlight, HasNoWiggleWhereThereIsNone) {
  double squares_m2 = 0.0;
  constexpr int kSeeds = 8;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const DepthScene scene = test::makeDepthScene(seed, test::timeOfFlight(), cellViews(60), {0.15, 4e-4, 1e-4});
    const DepthOutcome outcome = solveKnowingTheBoards(scene, seed);
    ASSERT_EQ(outcome.status, DepthStatus::kSolved) << outcome.reason;
    for (double range_m = 0.5; range_m < 1.2; range_m += 0.05)
      squares_m2 += std::pow(outcome.result->model.wiggling(range_m), 2) / (15 * kSeeds);
  }
  EXPECT_LT(std::sqrt(squares_m2), 1e-4);
}

INSTANTIATE_TEST_SUITE_P(Sensors, SolveDepth,
                         testing::Values(DepthSensor::kTimeOfFlight, DepthSensor::kStructuredLight),
                         [](const auto& sensor) { return std::string(sensor.param == DepthSensor::kTimeOfFlight
                                                                       ? "TimeOfFlight" : "StructuredLight"); });

TEST(SolveDepthRefusals, TooFewViewsAndContradictions) {
  DepthScene scene = test::makeDepthScene(6, test::timeOfFlight(), cellViews(12), {0.15, 4e-4, 6e-4});
  EXPECT_EQ(solveDepth(scene.board, scene.truth.camera, scene.observations, "another", scene.truth.sensor).status,
            DepthStatus::kTooFewViews);
  for (std::size_t i = 0; i < scene.observations.size(); ++i) {
    for (DepthPatch& patch : scene.observations[i].views[0].depth->patches) {
      patch.depth_m *= 0.6 + 0.08 * static_cast<double>((5 * i) % 12);
    }
  }
  const DepthOutcome outcome = solve(scene);
  EXPECT_EQ(outcome.status, DepthStatus::kInconsistent);
  EXPECT_FALSE(outcome.reason.empty());
  scene.observations[0].views[0].depth->patches[0].sigma_m = 0.0;
  EXPECT_THROW((void)solve(scene), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::calib
