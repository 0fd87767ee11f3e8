// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/board_pose.h"

#include <gtest/gtest.h>

#include <ctime>

#include "calib_scene.h"

namespace servocal::calib {
namespace {

double cpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

TEST(BoardPoses, RecoversTruthWithoutNoise) {
  for (const CameraModel& camera : {test::hdCamera(), test::rationalCamera()}) {
    const test::Scene scene = test::makeScene(11, {}, camera);
    for (std::size_t i = 0; i < scene.cMo.size(); ++i) {
      const auto poses = boardPoses(scene.board, camera, scene.observations[i].views[0].detection);
      ASSERT_FALSE(poses.empty());
      EXPECT_LT(distanceM(poses[0].cMo, scene.cMo[i]), 1e-9);
      EXPECT_LT(angleRad(poses[0].cMo, scene.cMo[i]), 1e-8);
      EXPECT_LT(poses[0].rms_px, 1e-6);
    }
  }
}

// From afar and slightly tilted, two poses explain the corners almost equally well; both are handed out.
TEST(BoardPoses, KeepsBothPlanarSolutions) {
  const CameraModel camera = test::hdCamera();
  std::mt19937_64 random(3);
  int both = 0, either = 0;
  for (int i = 0; i < 100; ++i) {
    test::SceneOptions options;
    options.near_m = options.far_m = 1.2;
    options.max_tilt_rad = 0.35;
    const Pose<Color, Board> cMo = test::randomView(camera, options, random);
    const BoardDetection detection = test::detect({}, camera, cMo, 0.2, random);
    const auto poses = boardPoses({}, camera, detection);
    ASSERT_FALSE(poses.empty());
    if (poses.size() == 2) {
      ++both;
      EXPECT_LE(poses[0].rms_px, poses[1].rms_px);
    }
    for (const BoardPose& pose : poses) {
      if (angleRad(pose.cMo, cMo) < 0.15) {
        ++either;
        break;
      }
    }
  }
  EXPECT_GT(both, 60);
  EXPECT_GE(either, 97);
}

// The error of the pose is what the noise makes unavoidable: a whitened residual of one per degree of freedom.
TEST(BoardPoses, ResidualIsThatOfTheNoise) {
  test::SceneOptions options;
  options.views = 200;
  options.noise.corner_px = 0.2;
  const test::Scene scene = test::makeScene(4, options);
  double squares = 0;
  for (const Observation& observation : scene.observations) {
    const auto poses = boardPoses(scene.board, scene.camera, observation.views[0].detection);
    ASSERT_FALSE(poses.empty());
    squares += poses[0].rms_px * poses[0].rms_px;
  }
  // 24 corners of two numbers, six of 48 degrees of freedom taken by the pose; 200 views: 1 % of sigma.
  const double expected = 0.2 * std::sqrt(2.0 * 42.0 / 48.0);
  EXPECT_NEAR(std::sqrt(squares / 200), expected, 0.03 * expected);
}

// A blurred corner with an honest covariance hardly moves the pose.
TEST(BoardPoses, WeighsCornersByTheirCovariance) {
  const test::Scene scene = test::makeScene(9);
  BoardDetection detection = scene.observations[0].views[0].detection;
  detection.corners[5].pixel += Eigen::Vector2d(6.0, -4.0);
  const auto misled = boardPoses(scene.board, scene.camera, detection);
  detection.corners[5].covariance_px2 = Eigen::Matrix2d::Identity() * 36.0;
  const auto weighed = boardPoses(scene.board, scene.camera, detection);
  ASSERT_FALSE(misled.empty());
  ASSERT_FALSE(weighed.empty());
  EXPECT_GT(angleRad(misled[0].cMo, scene.cMo[0]), 20 * angleRad(weighed[0].cMo, scene.cMo[0]));
}

TEST(BoardPoses, IsEmptyWithoutAPlane) {
  const test::Scene scene = test::makeScene(2);
  BoardDetection detection = scene.observations[0].views[0].detection;
  BoardDetection row = detection, three = detection;
  row.corners.resize(scene.board.as<Checkerboard>()->cornersX());
  three.corners.resize(3);
  EXPECT_TRUE(boardPoses(scene.board, scene.camera, row).empty());
  EXPECT_TRUE(boardPoses(scene.board, scene.camera, three).empty());
  EXPECT_TRUE(boardPoses(scene.board, scene.camera, {}).empty());
  EXPECT_FALSE(refineBoardPose(scene.board, scene.camera, row, scene.cMo[0]).has_value());
}

TEST(BoardPoses, ThrowsOnAForeignCornerId) {
  const test::Scene scene = test::makeScene(2);
  BoardDetection detection = scene.observations[0].views[0].detection;
  detection.corners.back().id = scene.board.cornerCount();
  EXPECT_THROW(boardPoses(scene.board, scene.camera, detection), std::invalid_argument);
}

TEST(RefineBoardPose, FollowsTheBoardFromTheLastPose) {
  test::SceneOptions options;
  options.noise.corner_px = 0.1;
  const test::Scene scene = test::makeScene(21, options);
  std::mt19937_64 random(1);
  for (std::size_t i = 0; i < scene.cMo.size(); ++i) {
    const BoardDetection& detection = scene.observations[i].views[0].detection;
    const auto start = test::disturbed(scene.cMo[i], random, 0.005, 0.03);
    const auto tracked = refineBoardPose(scene.board, scene.camera, detection, start);
    const auto found = boardPoses(scene.board, scene.camera, detection);
    ASSERT_TRUE(tracked.has_value());
    EXPECT_LT(distanceM(tracked->cMo, found[0].cMo), 1e-6);
    EXPECT_LT(angleRad(tracked->cMo, found[0].cMo), 1e-5);
  }
}

TEST(RefineBoardPose, SaysSoIfTheStartIsBehindTheCamera) {
  const test::Scene scene = test::makeScene(2);
  const auto behind = Pose<Color, Board>::fromRotationVector({0, 0, 0}, {0, 0, -0.5});
  EXPECT_FALSE(refineBoardPose(scene.board, scene.camera, scene.observations[0].views[0].detection, behind));
  EXPECT_THROW((void)refineBoardPose(scene.board, scene.camera, {}, Pose<Color, Board>()),
               std::invalid_argument);
}

// It runs in every cycle of the servo loop. 0.3 ms of CPU time are the budget; the margin is for other machines.
TEST(BoardPoses, IsFastEnoughForAServoLoop) {
  test::SceneOptions options;
  options.noise.corner_px = 0.2;
  const test::Scene scene = test::makeScene(6, options);
  const double start = cpuSeconds();
  int calls = 0;
  for (int repeat = 0; repeat < 10; ++repeat) {
    for (const Observation& observation : scene.observations) {
      calls += boardPoses(scene.board, scene.camera, observation.views[0].detection).empty() ? 0 : 1;
    }
  }
  const double each_ms = 1e3 * (cpuSeconds() - start) / calls;
  RecordProperty("boardPoses_ms", std::to_string(each_ms));
  std::cout << "boardPoses: " << each_ms << " ms of CPU time per call\n";
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__)
  EXPECT_LT(each_ms, 0.6);
#endif
}

}  // namespace
}  // namespace servocal::calib
