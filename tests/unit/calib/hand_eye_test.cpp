// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/hand_eye.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "calib_scene.h"

namespace servocal::calib {
namespace {

std::vector<HandEyeView> viewsOf(const test::Scene& scene) {
  std::vector<HandEyeView> views;
  for (std::size_t i = 0; i < scene.cMo.size(); ++i) views.push_back({scene.bMe[i], scene.cMo[i]});
  return views;
}

Pose<Base, Color> truth(const test::Scene& scene) { return Pose<Base, Color>(scene.camera_pose); }

test::Scene sceneWith(std::uint64_t seed, int views) {
  test::SceneOptions options;
  options.views = views;
  return test::makeScene(seed, options);
}

// Exact input, exact answer: any error left is ours.
TEST(SolveHandEye, RecoversTruthFromNoiselessViews) {
  for (const int count : {3, 8, 40}) {
    const test::Scene scene = sceneWith(7, count);
    const HandEyeResult result = solveHandEye(viewsOf(scene));
    ASSERT_EQ(result.status, HandEyeStatus::kSolved) << toString(result.status);
    EXPECT_LT(distanceM(*result.bMc, truth(scene)), 1e-9);
    EXPECT_LT(angleRad(*result.bMc, truth(scene)), 1e-9);
    EXPECT_LT(distanceM(*result.eMo, Pose<EndEffector, Board>(scene.board_pose)), 1e-9);
    EXPECT_LT(angleRad(*result.eMo, Pose<EndEffector, Board>(scene.board_pose)), 1e-9);
    EXPECT_LT(result.rms_translation_m, 1e-9);
    EXPECT_LT(result.rms_rotation_rad, 1e-9);
    EXPECT_GT(result.axis_spread, 0.05);
    EXPECT_LE(result.axis_spread, 1.0);
  }
}

// A camera on the flange is the same problem with the robot poses inverted.
TEST(SolveHandEye, RecoversACameraOnTheFlange) {
  test::SceneOptions options;
  options.views = 10;
  options.mount = Mount::kFlange;
  const test::Scene scene = test::makeScene(3, options);
  std::vector<HandEyeView> views;
  for (std::size_t i = 0; i < scene.cMo.size(); ++i) {
    views.push_back({relabel<Base, EndEffector>(scene.bMe[i].inverse()), scene.cMo[i]});
  }
  const HandEyeResult result = solveHandEye(views);
  ASSERT_EQ(result.status, HandEyeStatus::kSolved);
  EXPECT_LT(distanceM(*result.bMc, truth(scene)), 1e-9);
  EXPECT_LT(angleRad(*result.bMc, truth(scene)), 1e-9);
}

TEST(SolveHandEye, DoesNotDependOnTheOrderOfViews) {
  test::SceneOptions options;
  options.views = 12;
  options.noise.robot_m = 1e-3;
  options.noise.robot_rad = 2e-3;
  const test::Scene scene = test::makeScene(5, options);
  std::vector<HandEyeView> views = viewsOf(scene);
  for (std::size_t i = 0; i < views.size(); ++i) views[i].bMe = scene.observations[i].robot->bMe;
  const HandEyeResult forward = solveHandEye(views);
  std::reverse(views.begin(), views.end());
  std::swap(views[2], views[9]);
  const HandEyeResult shuffled = solveHandEye(views);
  ASSERT_EQ(forward.status, HandEyeStatus::kSolved);
  EXPECT_LT(distanceM(*forward.bMc, *shuffled.bMc), 1e-11);
  EXPECT_LT(angleRad(*forward.bMc, *shuffled.bMc), 1e-11);
  EXPECT_NEAR(forward.axis_spread, shuffled.axis_spread, 1e-11);
}

// Half turns of the board about the optical axis, where axes of rotation lose their sign.
TEST(SolveHandEye, SurvivesHalfTurns) {
  std::mt19937_64 random(17);
  test::SceneOptions options;
  options.views = 10;
  std::vector<Pose<Color, Board>> cMo = test::randomViews(test::hdCamera(), {}, options, random);
  for (std::size_t i = 0; i < cMo.size(); i += 2) {
    cMo[i] = cMo[i] * Pose<Board, Board>::fromRotationVector({0, 0, M_PI}, {0, 0, 0});
  }
  const test::Scene scene = test::sceneOf(cMo, test::hdCamera(), {}, random);
  const HandEyeResult result = solveHandEye(viewsOf(scene));
  ASSERT_EQ(result.status, HandEyeStatus::kSolved);
  EXPECT_LT(distanceM(*result.bMc, truth(scene)), 1e-9);
}

TEST(SolveHandEye, RefusesTooFewViews) {
  std::vector<HandEyeView> views = viewsOf(sceneWith(7, 3));
  views.pop_back();
  const HandEyeResult result = solveHandEye(views);
  EXPECT_EQ(result.status, HandEyeStatus::kTooFewViews);
  EXPECT_FALSE(result.bMc.has_value());
  EXPECT_FALSE(result.eMo.has_value());
  EXPECT_EQ(solveHandEye({}).status, HandEyeStatus::kTooFewViews);
}

// An arm that only spins about one axis cannot determine bMc. Saying so is the feature.
TEST(SolveHandEye, RefusesRotationsAboutASingleAxis) {
  const test::Scene scene = sceneWith(7, 1);
  std::mt19937_64 random(1);
  std::vector<HandEyeView> views;
  for (int i = 0; i < 10; ++i) {
    const Pose<EndEffector, EndEffector> turn = Pose<EndEffector, EndEffector>::fromRotationVector(
        {0, 0, 0.15 * i}, test::randomVector(random, 0.1));
    const Pose<Base, EndEffector> bMe = scene.bMe[0] * turn;
    const Pose<Color, Board> cMo(scene.camera_pose.inverse() * bMe.isometry() * scene.board_pose);
    // Robot noise makes the axes not exactly parallel; that must not be taken for information.
    views.push_back({test::disturbed(bMe, random, 3e-4, 5e-4), cMo});
  }
  const HandEyeResult result = solveHandEye(views);
  EXPECT_EQ(result.status, HandEyeStatus::kRotationAxesParallel) << result.axis_spread;
  EXPECT_FALSE(result.bMc.has_value());
  EXPECT_LT(result.axis_spread, 0.01);
}

TEST(SolveHandEye, RefusesPureTranslations) {
  const test::Scene scene = sceneWith(7, 1);
  std::vector<HandEyeView> views;
  for (int i = 0; i < 6; ++i) {
    Eigen::Isometry3d bMe = scene.bMe[0].isometry();
    bMe.translation()[i % 3] += 0.02 * i;
    views.push_back({Pose<Base, EndEffector>(bMe),
                     Pose<Color, Board>(scene.camera_pose.inverse() * bMe * scene.board_pose)});
  }
  const HandEyeResult result = solveHandEye(views);
  EXPECT_EQ(result.status, HandEyeStatus::kRotationAxesParallel);
  EXPECT_EQ(result.axis_spread, 0.0);
}

TEST(SolveHandEye, ThrowsOnAPoseThatIsNotFiniteAndNamesIt) {
  std::vector<HandEyeView> views = viewsOf(sceneWith(7, 5));
  views[3].cMo = Pose<Color, Board>();
  try {
    (void)solveHandEye(views);
    FAIL() << "no exception";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("view 3"), std::string::npos) << error.what();
  }
}

// Negative control: the measures used above do see a 1 mm and a 1 mrad mistake.
TEST(SolveHandEye, MeasuresSeeASmallMistake) {
  const test::Scene scene = sceneWith(7, 8);
  const Pose<Base, Color> wrong =
      truth(scene) * Pose<Color, Color>::fromRotationVector({0, 1e-3, 0}, {1e-3, 0, 0});
  EXPECT_NEAR(distanceM(wrong, truth(scene)), 1e-3, 1e-12);
  EXPECT_NEAR(angleRad(wrong, truth(scene)), 1e-3, 1e-12);
}

}  // namespace
}  // namespace servocal::calib
