// SPDX-License-Identifier: GPL-3.0-or-later
// Color and infrared of one camera: two streams of one name.
#include <gtest/gtest.h>

#include <stdexcept>

#include "depth_scene.h"
#include "servocal/calib/camera_pair.h"

namespace servocal::calib {
namespace {

const Pose<Color, Color> kBeside =
    Pose<Color, Color>::fromRotationVector({0.004, -0.006, 0.003}, {0.052, 0.001, -0.002});

TEST(ColorInfrared, TwoStreamsOfOneCameraArePaired) {
  const PairCamera color{"left", Stream::kColor, test::hdCamera()};
  const PairCamera infrared{"left", Stream::kInfrared, test::depthCamera()};
  const BoardSpec board;
  std::mt19937_64 random(1);
  test::SceneOptions options;
  options.views = 30;
  options.near_m = 0.55;
  options.far_m = 1.0;
  std::vector<Observation> observations;
  for (const Pose<Color, Board>& iMo : test::randomViews(infrared.model, board, options, random)) {
    Observation observation;
    observation.id = static_cast<std::int64_t>(observations.size()) + 1;
    for (const PairCamera* camera : {&color, &infrared}) {
      StreamObservation seen;
      seen.camera = camera->name;
      seen.stream = camera->stream;
      const Pose<Color, Board> cMo = camera == &infrared ? iMo : kBeside * iMo;
      seen.detection = test::detect(board, camera->model, cMo, 0.1, random);
      if (seen.detection.corners.size() >= 8) observation.views.push_back(seen);
    }
    observations.push_back(observation);
  }
  const PairOutcome outcome = solveCameraPair(board, color, infrared, observations);
  ASSERT_EQ(outcome.status, PairStatus::kSolved);
  const Pose<Color, Color> found(outcome.solution->first_by_second);
  EXPECT_LT(distanceM(found, kBeside), 0.001);
  EXPECT_LT(angleRad(found, kBeside), 0.15 * M_PI / 180.0);
}

TEST(ColorInfrared, ByRobotTheErrorIsWhatTheCovarianceClaims) {
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal;
  HandEyeSolution first, second;
  const auto bMc = test::randomPose<Base, Color>(random, 2.0, 1.0);
  const auto bMi = bMc * kBeside;
  first.camera_sigma << 2e-4, 3e-4, 1e-4, 4e-4, 2e-4, 5e-4;
  second.camera_sigma << 1e-4, 2e-4, 4e-4, 1e-4, 6e-4, 3e-4;
  const auto draw = [&](const Pose<Base, Color>& truth, const Eigen::Matrix<double, 6, 1>& sigma) {
    Eigen::Matrix<double, 6, 1> error;
    for (int i = 0; i < 6; ++i) error[i] = sigma[i] * normal(random);
    const auto turn = Pose<Base, Base>::fromRotationVector(error.tail<3>(), {0, 0, 0});
    return Pose<Base, Color>(turn.rotation() * truth.rotation(), truth.translation() + error.head<3>())
        .isometry();
  };
  double squares = 0.0;
  constexpr int kDraws = 500;
  for (int k = 0; k < kDraws; ++k) {
    first.camera_pose = draw(bMc, first.camera_sigma);
    second.camera_pose = draw(bMi, second.camera_sigma);
    const CameraPair pair =
        pairByRobot({"left", Stream::kColor, {}}, first, {"left", Stream::kInfrared, {}}, second);
    const Eigen::AngleAxisd turn(pair.first_by_second.linear() * kBeside.rotation().transpose());
    Eigen::Matrix<double, 6, 1> error;
    error << pair.first_by_second.translation() - kBeside.translation(), turn.angle() * turn.axis();
    squares += error.dot(pair.covariance.ldlt().solve(error)) / (6 * kDraws);
  }
  EXPECT_NEAR(squares, 1.0, 4.0 * std::sqrt(2.0 / (6 * kDraws)));
  second.mount = Mount::kFlange;
  EXPECT_THROW((void)pairByRobot({}, first, {}, second), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::calib
