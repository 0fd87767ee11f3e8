// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/eye_to_hand.h"

#include <gtest/gtest.h>

#include "depth_scene.h"

namespace servocal::calib {
namespace {

/// Stops with corner depths; noise per stop, across (m) and along the optical axis.
std::vector<BoardPoint> pointsOf(const test::DepthScene& scene, double lateral_m, double depth_m,
                                 std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Observation> observations = scene.observations;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    StreamObservation& seen = observations[i].views[0];
    for (const Corner& corner : seen.detection.corners) {
      const double z = (scene.cell.cMo[i] * scene.board.corner(corner.id)).z();
      seen.depth->corners.push_back({corner.id, test::distorted(scene.truth, corner.pixel, z), 500});
    }
  }
  auto points = boardPoints(scene.board, scene.truth, observations, test::kCamera,
                            Pose<EndEffector, Board>(scene.cell.board_pose));
  for (BoardPoint& point : points) {
    const double x = normal(random), y = normal(random), z = normal(random);
    point.in_camera += Eigen::Vector3d(lateral_m * x, lateral_m * y, depth_m * z);
  }
  return points;
}

test::DepthScene makeStops(std::uint64_t seed, int views, double far_m = 1.0) {
  test::SceneOptions options;
  options.views = views;
  options.near_m = 0.7;
  options.far_m = far_m;
  return test::makeDepthScene(seed, test::timeOfFlight(), options);
}

TEST(EyeToHand, RecoversTruthFromNoiselessStops) {
  const test::DepthScene scene = makeStops(1, 20);
  const auto points = pointsOf(scene, 0.0, 0.0, 1);
  ASSERT_EQ(points.size(), 20u);
  const AffineOutcome affine = solveAffineEyeToHand(points);
  ASSERT_EQ(affine.status, EyeToHandStatus::kSolved) << toString(affine.status);
  EXPECT_LT((affine.result->bAc - scene.cell.camera_pose.matrix().topRows<3>()).norm(), 1e-7);
  const RigidOutcome rigid = solveRigidEyeToHand(points);
  ASSERT_EQ(rigid.status, EyeToHandStatus::kSolved) << toString(rigid.status);
  EXPECT_LT(distanceM(rigid.result->bMi, Pose<Base, Infrared>(scene.cell.camera_pose)), 1e-7);
}

TEST(EyeToHand, CovarianceIsTheSpread) {
  constexpr int kSeeds = 60;
  double squares = 0.0;
  const test::DepthScene scene = makeStops(2, 30);
  for (int seed = 1; seed <= kSeeds; ++seed) {
    const RigidOutcome rigid =
        solveRigidEyeToHand(pointsOf(scene, 0.0015, 0.003, static_cast<std::uint64_t>(seed)));
    ASSERT_EQ(rigid.status, EyeToHandStatus::kSolved);
    EXPECT_GT(rigid.result->depth_sigma_m, rigid.result->lateral_sigma_m);
    const Eigen::AngleAxisd turn(rigid.result->bMi.rotation() * scene.cell.camera_pose.linear().transpose());
    Eigen::Matrix<double, 6, 1> error;
    error << rigid.result->bMi.translation() - scene.cell.camera_pose.translation(),
        turn.angle() * turn.axis();
    squares += error.dot(rigid.result->covariance.ldlt().solve(error)) / (6 * kSeeds);
  }
  // The scatter is itself estimated from 30 points: a tenth more.
  EXPECT_NEAR(squares, 1.1, 4.0 * std::sqrt(2.0 / (6 * kSeeds)));
}

TEST(EyeToHand, WrongStopsAreLeftOut) {
  const test::DepthScene scene = makeStops(3, 24);
  auto points = pointsOf(scene, 0.001, 0.002, 3);
  for (std::size_t i = 0; i < points.size(); i += 5) points[i].in_camera.z() += 0.08;
  const RigidOutcome rigid = solveRigidEyeToHand(points);
  ASSERT_EQ(rigid.status, EyeToHandStatus::kSolved);
  EXPECT_EQ(rigid.result->inliers, 19);
  EXPECT_LT(distanceM(rigid.result->bMi, Pose<Base, Infrared>(scene.cell.camera_pose)), 0.008);
  const AffineOutcome affine = solveAffineEyeToHand(points);
  ASSERT_EQ(affine.status, EyeToHandStatus::kSolved);
  EXPECT_EQ(affine.result->inliers, 19);
}

TEST(EyeToHand, OneDistanceIsRefusedByTheAffineOnly) {
  const test::DepthScene scene = makeStops(4, 20, 0.7);
  const auto points = pointsOf(scene, 0.001, 0.002, 4);
  EXPECT_EQ(solveAffineEyeToHand(points).status, EyeToHandStatus::kPointsFlat);
  EXPECT_EQ(solveRigidEyeToHand(points).status, EyeToHandStatus::kSolved);
  EXPECT_EQ(solveAffineEyeToHand({}).status, EyeToHandStatus::kTooFewPoints);
}

TEST(EyeToHand, RefusesNoise) {
  const test::DepthScene scene = makeStops(5, 20);
  EXPECT_EQ(solveRigidEyeToHand(pointsOf(scene, 0.2, 0.2, 5)).status, EyeToHandStatus::kNoConsensus);
}

}  // namespace
}  // namespace servocal::calib
