// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/camera_pair.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "calib_scene.h"

namespace servocal::calib {
namespace {

constexpr double kNoisePx = 0.1;

struct PairScene {
  BoardSpec board;
  PairCamera first{"left", Stream::kColor, test::hdCamera()};
  PairCamera second{"right", Stream::kColor, test::hdCamera()};
  Eigen::Isometry3d c1Mc2;
  std::vector<Observation> observations;
};

/// Two cameras 60 mm apart that converge a little; every view shows the whole board to the first one.
PairScene makePair(std::uint64_t seed, int views, const BoardSpec& board = {}) {
  PairScene scene;
  scene.board = board;
  scene.second.model.parameters << 900.0, 902.0, 930.0, 560.0, -0.05, 0.03, 0.0, 0.0, 0.0;
  scene.c1Mc2 = Pose<Color, Color>::fromRotationVector({0.02, -0.06, 0.01}, {0.06, 0.004, -0.01}).isometry();
  std::mt19937_64 random(seed);
  test::SceneOptions options;
  options.views = views;
  for (const Pose<Color, Board>& c1Mo : test::randomViews(scene.first.model, board, options, random)) {
    Observation observation;
    observation.id = static_cast<std::int64_t>(scene.observations.size()) + 1;
    observation.stage = "view " + std::to_string(observation.id);
    for (const PairCamera* camera : {&scene.first, &scene.second}) {
      const Pose<Color, Board> cMo =
          camera == &scene.first ? c1Mo : Pose<Color, Board>(scene.c1Mc2.inverse() * c1Mo.isometry());
      StreamObservation seen;
      seen.camera = camera->name;
      seen.detection = test::detect(board, camera->model, cMo, kNoisePx, random);
      observation.views.push_back(seen);
    }
    scene.observations.push_back(observation);
  }
  return scene;
}

/// Error in the parameters of PairSolution::covariance.
Eigen::Matrix<double, 6, 1> errorOf(const PairSolution& solution, const Eigen::Isometry3d& truth) {
  const Eigen::AngleAxisd turn(solution.first_by_second.linear() * truth.linear().transpose());
  Eigen::Matrix<double, 6, 1> error;
  error << solution.first_by_second.translation() - truth.translation(), turn.angle() * turn.axis();
  return error;
}

std::vector<std::string> leftOut(const PairSolution& solution) {
  std::vector<std::string> names;
  for (const ViewResidual& view : solution.views) {
    if (!view.used) names.push_back(view.name);
  }
  return names;
}

TEST(CameraPair, ErrorIsWhatTheCovarianceClaims) {
  double squares = 0.0;
  constexpr int kSeeds = 40;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    const PairScene scene = makePair(seed, 12);
    const PairOutcome outcome = solveCameraPair(scene.board, scene.first, scene.second, scene.observations);
    ASSERT_EQ(outcome.status, PairStatus::kSolved) << seed;
    const auto error = errorOf(*outcome.solution, scene.c1Mc2);
    squares += error.dot(outcome.solution->covariance.ldlt().solve(error));
    EXPECT_TRUE(leftOut(*outcome.solution).empty()) << seed;
    EXPECT_NEAR(outcome.solution->rms_px, std::sqrt(2.0) * kNoisePx, 0.02);
  }
  // Chi-square of 240 degrees of freedom, scaled by the estimated noise: within four of its deviations.
  EXPECT_NEAR(squares / (6 * kSeeds), 1.0, 4.0 * std::sqrt(2.0 / (6 * kSeeds)));
}

TEST(CameraPair, OneViewIsEnough) {
  const PairScene scene = makePair(3, 1);
  const PairOutcome outcome = solveCameraPair(scene.board, scene.first, scene.second, scene.observations);
  ASSERT_EQ(outcome.status, PairStatus::kSolved);
  EXPECT_LT(errorOf(*outcome.solution, scene.c1Mc2).head<3>().norm(), 0.01);
}

TEST(CameraPair, TurnsOfASymmetricBoardAreResolved) {
  const BoardSpec plain{Checkerboard{7, 5, 0.03, false}};
  PairScene scene = makePair(4, 10, plain);
  for (std::size_t i = 0; i < scene.observations.size(); ++i) {
    for (StreamObservation& seen : scene.observations[i].views) {
      seen.detection.orientation_known = false;
      if (seen.camera != "right" || i % 3 == 0) continue;  // The second camera names the corners the other way round.
      for (Corner& corner : seen.detection.corners) corner.id = plain.turnedId(corner.id, 1);
      std::reverse(seen.detection.corners.begin(), seen.detection.corners.end());
    }
  }
  const PairOutcome outcome = solveCameraPair(plain, scene.first, scene.second, scene.observations);
  ASSERT_EQ(outcome.status, PairStatus::kSolved);
  EXPECT_TRUE(leftOut(*outcome.solution).empty());
  EXPECT_LT(errorOf(*outcome.solution, scene.c1Mc2).head<3>().norm(), 0.001);

  scene.observations.resize(1);  // One image pair could be read either way.
  EXPECT_EQ(solveCameraPair(plain, scene.first, scene.second, scene.observations).status, PairStatus::kAmbiguous);
}

TEST(CameraPair, NamesImagesThatDoNotBelongTogether) {
  PairScene scene = makePair(5, 12);
  std::swap(scene.observations[2].views[1].detection, scene.observations[7].views[1].detection);
  // The board moved by 2 mm between the two exposures: 4 px.
  for (Corner& corner : scene.observations[9].views[1].detection.corners) corner.pixel.x() += 4.0;
  const PairOutcome outcome = solveCameraPair(scene.board, scene.first, scene.second, scene.observations);
  ASSERT_EQ(outcome.status, PairStatus::kSolved);
  EXPECT_EQ(leftOut(*outcome.solution), (std::vector<std::string>{"view 3", "view 8", "view 10"}));
  EXPECT_LT(errorOf(*outcome.solution, scene.c1Mc2).head<3>().norm(), 0.001);
}

TEST(CameraPair, OrderDoesNotMatter) {
  PairScene scene = makePair(6, 9);
  const PairOutcome forward = solveCameraPair(scene.board, scene.first, scene.second, scene.observations);
  std::reverse(scene.observations.begin(), scene.observations.end());
  const PairOutcome backward = solveCameraPair(scene.board, scene.first, scene.second, scene.observations);
  ASSERT_TRUE(forward.solution && backward.solution);
  EXPECT_LT((forward.solution->first_by_second.matrix() - backward.solution->first_by_second.matrix()).norm(), 1e-8);
}

TEST(CameraPair, NeedsACommonView) {
  PairScene scene = makePair(7, 4);
  for (std::size_t i = 0; i < 4; ++i) scene.observations[i].views.erase(scene.observations[i].views.begin() + i % 2);
  EXPECT_EQ(solveCameraPair(scene.board, scene.first, scene.second, scene.observations).status,
            PairStatus::kNoCommonView);
}

}  // namespace
}  // namespace servocal::calib
