// SPDX-License-Identifier: GPL-3.0-or-later
// Views spoilt on purpose: exactly those are named, with the cause.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "calib_scene.h"
#include "servocal/calib/board_pose.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/calib/reprojection.h"

namespace servocal::calib {
namespace {

constexpr int kInjections = 20;

using Injected = std::map<std::size_t, std::set<ViewCause>>;  // by view, the causes that are true of it

void expectNamed(const std::vector<ViewResidual>& views, const Injected& injected, std::uint64_t seed) {
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto bad = injected.find(i);
    EXPECT_EQ(views[i].used, bad == injected.end())
        << "seed " << seed << ", view " << i << ": " << views[i].reason;
    EXPECT_EQ(views[i].reason.empty(), views[i].used);
    if (views[i].used || bad == injected.end()) continue;
    EXPECT_TRUE(bad->second.count(views[i].cause))
        << "seed " << seed << ", view " << i << ": " << views[i].reason;
  }
}

BoardDetection& detectionOf(test::Scene& scene, std::size_t view) {
  return scene.observations[view].views[0].detection;
}

std::vector<std::size_t> someViews(std::size_t views, std::size_t count, std::mt19937_64& random) {
  std::vector<std::size_t> all(views);
  for (std::size_t i = 0; i < views; ++i) all[i] = i;
  std::shuffle(all.begin(), all.end(), random);
  all.resize(count);
  return all;
}

/// Spoils the corners of one view in one of several ways.
std::set<ViewCause> spoilImage(test::Scene& scene, std::size_t view, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  BoardDetection& detection = detectionOf(scene, view);
  switch (random() % 4) {
    case 0: {  // wrong corners
      const double sigma_px = 1.0 + 30.0 * uniform(random);
      for (Corner& corner : detection.corners) {
        corner.pixel += sigma_px * Eigen::Vector2d(normal(random), normal(random));
      }
      return {ViewCause::kCorners};
    }
    case 1: {  // a board of other proportions
      BoardSpec other = scene.board;
      const double stretch = 1.1 + uniform(random);
      detection.corners.clear();
      for (int id = 0; id < other.cornerCount(); ++id) {
        Eigen::Vector3d point = other.corner(id);
        point.y() *= stretch;
        const auto pixel = scene.camera.project(scene.cMo[view] * point);
        if (pixel) detection.corners.push_back({id, *pixel, Eigen::Matrix2d::Identity() * 0.01});
      }
      return {ViewCause::kCorners};
    }
    case 2: {  // one corner far off
      detection.corners[random() % detection.corners.size()].pixel += Eigen::Vector2d(25.0, -10.0);
      return {ViewCause::kCorners};
    }
    default: {  // blurred, and the detector knows
      const double sigma_px = 0.8 + uniform(random);
      for (Corner& corner : detection.corners) {
        corner.pixel += sigma_px * Eigen::Vector2d(normal(random), normal(random));
        corner.covariance_px2 = Eigen::Matrix2d::Identity() * sigma_px * sigma_px;
      }
      return {ViewCause::kBlurred};
    }
  }
}

TEST(Outliers, OfIntrinsicsAreNamedUpToAThird) {
  double fx_squares = 0;
  for (std::uint64_t seed = 1; seed <= kInjections; ++seed) {
    std::mt19937_64 random(seed);
    test::SceneOptions options;
    options.views = 20;
    options.noise.corner_px = 0.1;
    test::Scene scene = test::makeScene(5000 + seed, options);
    Injected injected;
    for (const std::size_t view : someViews(20, 1 + seed % 6, random)) {
      injected[view] = spoilImage(scene, view, random);
    }
    const IntrinsicsOutcome outcome =
        solveIntrinsics(scene.board, scene.observations, test::kCamera, Stream::kColor);
    ASSERT_EQ(outcome.status, IntrinsicsStatus::kSolved) << toString(outcome.status) << " seed " << seed;
    expectNamed(outcome.result->views, injected, seed);
    fx_squares += std::pow((outcome.result->camera.fx() - scene.camera.fx()) / outcome.result->sigma[0], 2);
  }
  // The claim holds for the rest as if nothing had happened: 20 seeds, 16 %, three of those.
  EXPECT_NEAR(std::sqrt(fx_squares / kInjections), 1.0, 0.48);
}

// One view is off by a hundred pixels, one by one pixel: the first must not hide the second.
TEST(Outliers, ATerribleViewHidesNoBadOne) {
  for (std::uint64_t seed = 1; seed <= kInjections; ++seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    test::SceneOptions options;
    options.views = 12;
    options.noise.corner_px = 0.1;
    test::Scene scene = test::makeScene(6000 + seed, options);
    const auto bad = someViews(12, 2, random);
    for (int k = 0; k < 2; ++k) {
      for (Corner& corner : detectionOf(scene, bad[k]).corners) {
        corner.pixel += (k == 0 ? 100.0 : 1.0) * Eigen::Vector2d(normal(random), normal(random));
      }
    }
    const IntrinsicsOutcome outcome =
        solveIntrinsics(scene.board, scene.observations, test::kCamera, Stream::kColor);
    ASSERT_EQ(outcome.status, IntrinsicsStatus::kSolved) << toString(outcome.status) << " seed " << seed;
    expectNamed(outcome.result->views, {{bad[0], {ViewCause::kCorners}}, {bad[1], {ViewCause::kCorners}}},
                seed);
  }
}

// Among perfect views one is the worst, by nothing.
TEST(Outliers, NoneAmongPerfectViews) {
  for (std::uint64_t seed = 1; seed <= kInjections; ++seed) {
    test::SceneOptions options;
    options.views = 12;
    test::Scene scene = test::makeScene(7000 + seed, options);
    for (Corner& corner : detectionOf(scene, 3).corners)
      corner.pixel.x() += corner.id % 2 == 0 ? 0.02 : -0.02;
    const IntrinsicsOutcome outcome =
        solveIntrinsics(scene.board, scene.observations, test::kCamera, Stream::kColor);
    ASSERT_EQ(outcome.status, IntrinsicsStatus::kSolved);
    expectNamed(outcome.result->views, {}, seed);
  }
}

/// Spoils robot poses (and one image) of a scene; says which, and what the reason must hold.
Injected spoilPoses(test::Scene& scene, std::uint64_t seed, std::map<std::size_t, std::string>& words) {
  std::mt19937_64 random(seed);
  const auto views = someViews(scene.observations.size(), 6, random);
  const auto bMe = [&](std::size_t view) -> Pose<Base, EndEffector>& {
    return scene.observations[view].robot->bMe;
  };
  Injected injected;
  // Two rows swapped.
  std::swap(bMe(views[0]), bMe(views[1]));
  words[views[0]] = "view" + std::to_string(views[1]);
  words[views[1]] = "view" + std::to_string(views[0]);
  injected[views[0]] = injected[views[1]] = {ViewCause::kRobotPose};
  // The inverse.
  bMe(views[2]) = relabel<Base, EndEffector>(bMe(views[2]).inverse());
  injected[views[2]] = {ViewCause::kRobotPose};
  words[views[2]] = "inverse";
  // 6 mm beside where it was.
  bMe(views[3]) = bMe(views[3]) * Pose<EndEffector, EndEffector>::fromRotationVector(
                                      {0, 0, 0}, {0.006 * (random() % 2 ? 1 : -1), 0, 0});
  injected[views[3]] = {ViewCause::kRobotPose};
  words[views[3]] = "mm and 0.";
  // Wrong corners.
  for (Corner& corner : detectionOf(scene, views[4]).corners) {
    corner.pixel += test::randomVector(random, 20.0).head<2>();
  }
  injected[views[4]] = {ViewCause::kCorners};
  // The pose that goes with the mirrored board, if it is another one.
  const auto poses = boardPoses(scene.board, scene.camera, detectionOf(scene, views[5]));
  if (poses.size() == 2 && angleRad(poses[0].cMo, poses[1].cMo) > 0.3) {
    const Eigen::Isometry3d& mirrored = poses[1].cMo.isometry();
    bMe(views[5]) = Pose<Base, EndEffector>(
        scene.mount == Mount::kFixed ? scene.camera_pose * mirrored * scene.board_pose.inverse()
                                     : scene.board_pose * mirrored.inverse() * scene.camera_pose.inverse());
    injected[views[5]] = {ViewCause::kPoseFlip};
  }
  return injected;
}

TEST(Outliers, OfTheHandEyeAreNamedWithTheirCause) {
  for (const Mount mount : {Mount::kFixed, Mount::kFlange}) {
    int flips = 0;
    for (std::uint64_t seed = 1; seed <= kInjections; ++seed) {
      test::SceneOptions options;
      options.views = 24;
      options.mount = mount;
      options.noise = {0.1, 0.0002, 0.0004};
      test::Scene scene = test::makeScene(8000 + seed, options);
      for (std::size_t i = 0; i < scene.observations.size(); ++i) {
        scene.observations[i].views[0].image_file = "view" + std::to_string(i);
      }
      std::map<std::size_t, std::string> words;
      const Injected injected = spoilPoses(scene, seed, words);
      for (const auto& [view, causes] : injected) flips += causes.count(ViewCause::kPoseFlip) ? 1 : 0;
      ReprojectionOptions solve;
      solve.mount = mount;
      const HandEyeOutcome outcome = solveHandEyeReprojection(scene.board, scene.camera, scene.observations,
                                                              test::kCamera, Stream::kColor, solve);
      ASSERT_EQ(outcome.status, HandEyeStatus::kSolved) << toString(outcome.status) << " seed " << seed;
      expectNamed(outcome.solution->views, injected, seed);
      for (const auto& [view, word] : words) {
        EXPECT_NE(outcome.solution->views[view].reason.find(word), std::string::npos)
            << "seed " << seed << ": " << outcome.solution->views[view].reason << " lacks " << word;
      }
      EXPECT_LT((outcome.solution->camera_pose.translation() - scene.camera_pose.translation()).norm(),
                0.001);

      // With all of them the answer is another, and every view is in it.
      solve.keep_outliers = true;
      const HandEyeOutcome with = solveHandEyeReprojection(scene.board, scene.camera, scene.observations,
                                                           test::kCamera, Stream::kColor, solve);
      ASSERT_TRUE(with.solution.has_value());
      EXPECT_GT(with.solution->rms_px, 2.0 * outcome.solution->rms_px);
    }
    EXPECT_GE(flips, kInjections / 2);  // the injection did happen
  }
}

// Far and flat, the mirrored pose often fits the image better. The robot knows, and the count says so.
TEST(Outliers, FlippedPosesAreResolvedByTheRobot) {
  int flips = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    test::SceneOptions options;
    options.views = 30;
    options.near_m = 2.0;
    options.far_m = 3.0;
    options.max_tilt_rad = 0.3;
    options.noise = {0.3, 0.0002, 0.0004};
    const test::Scene scene = test::makeScene(9000 + seed, options);
    int wrong = 0;
    for (std::size_t i = 0; i < scene.observations.size(); ++i) {
      const auto poses = boardPoses(scene.board, scene.camera, scene.observations[i].views[0].detection);
      wrong += poses.size() == 2 &&
               angleRad(poses[1].cMo, scene.cMo[i]) < 0.5 * angleRad(poses[0].cMo, scene.cMo[i]);
    }
    const HandEyeOutcome outcome = solveHandEyeReprojection(scene.board, scene.camera, scene.observations,
                                                            test::kCamera, Stream::kColor, {});
    ASSERT_EQ(outcome.status, HandEyeStatus::kSolved) << toString(outcome.status);
    expectNamed(outcome.solution->views, {}, seed);
    EXPECT_NEAR(outcome.solution->resolved_flips, wrong, 2) << seed;
    flips += outcome.solution->resolved_flips;
  }
  std::cout << flips << " flips of 150 views\n";
  EXPECT_GT(flips, 0);
}

struct Symmetric {
  const char* name;
  BoardSpec board;
  int turns;
};

std::vector<Symmetric> symmetricBoards() {
  Checkerboard plain, square;
  plain.hollow_corner = false;
  square.hollow_corner = false;
  square.squares_x = square.squares_y = 7;
  CircleGrid circles;
  circles.circles_x = circles.circles_y = 6;
  CircleGrid asymmetric;
  asymmetric.circles_x = 4;
  asymmetric.circles_y = 10;
  asymmetric.asymmetric = true;
  std::vector<Symmetric> boards = {{"7 x 5 squares", {}, 2},
                                   {"7 x 7 squares", {}, 4},
                                   {"6 x 6 circles", {}, 4},
                                   {"4 x 10 asymmetric circles", {}, 2}};
  boards[0].board.pattern = plain;
  boards[1].board.pattern = square;
  boards[2].board.pattern = circles;
  boards[3].board.pattern = asymmetric;
  return boards;
}

// Every view comes with the ids of some turn; the robot's motion says how they belong together.
TEST(SymmetricBoards, AreTurnedByTheRobot) {
  for (const Symmetric& symmetric : symmetricBoards()) {
    ASSERT_EQ(symmetric.board.symmetry(), symmetric.turns) << symmetric.name;
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      test::SceneOptions options;
      options.views = 16;
      options.noise = {0.1, 0.0002, 0.0004};
      test::Scene scene = test::makeScene(seed, options, test::hdCamera(), symmetric.board);
      std::mt19937_64 random(seed);
      int turned = 0;
      for (std::size_t i = 0; i < scene.observations.size(); ++i) {
        BoardDetection& detection = detectionOf(scene, i);
        detection.orientation_known = false;
        const int turn = i == 0 ? 0 : static_cast<int>(random() % symmetric.turns);
        turned += turn != 0;
        for (Corner& corner : detection.corners) corner.id = symmetric.board.turnedId(corner.id, turn);
        std::sort(detection.corners.begin(), detection.corners.end(),
                  [](const Corner& a, const Corner& b) { return a.id < b.id; });
      }
      ReprojectionOptions solve;
      for (const bool warm : {false, true}) {
        const HandEyeOutcome outcome = solveHandEyeReprojection(scene.board, scene.camera, scene.observations,
                                                                test::kCamera, Stream::kColor, solve);
        ASSERT_EQ(outcome.status, HandEyeStatus::kSolved) << symmetric.name << ", seed " << seed;
        const HandEyeSolution& solution = *outcome.solution;
        expectNamed(solution.views, {}, seed);
        EXPECT_EQ(solution.symmetric_views, 16) << symmetric.name << (warm ? " warm" : " cold");
        EXPECT_EQ(solution.resolved_turns, turned) << symmetric.name << (warm ? " warm" : " cold");
        EXPECT_LT((solution.camera_pose.translation() - scene.camera_pose.translation()).norm(), 0.002);
        EXPECT_LT(angleRad(Pose<EndEffector, Board>(solution.board_pose),
                           Pose<EndEffector, Board>(scene.board_pose)),
                  0.02)
            << symmetric.name;
        EXPECT_LT(solution.scatter_rad, 0.02);
        solve.start = solution;
      }
    }
  }
}

// Views in which half of the tags or fewer are seen count like any others.
TEST(PartialViews, OfATagGridAreSolved) {
  BoardSpec board;
  board.pattern = TagGrid{};
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    test::SceneOptions options;
    options.views = 20;
    options.noise = {0.1, 0.0002, 0.0004};
    test::Scene scene = test::makeScene(seed, options, test::hdCamera(), board);
    std::mt19937_64 random(seed);
    for (std::size_t i = 0; i < 20; ++i) {
      // Tags in a random half of the board; in one view two tags only.
      auto& corners = detectionOf(scene, i).corners;
      const double angle = 0.3 * static_cast<double>(random() % 21);
      corners.erase(std::remove_if(corners.begin(), corners.end(),
                                   [&](const Corner& corner) {
                                     const Eigen::Vector3d tag = board.corner(corner.id / 4 * 4);
                                     if (i == 7) return corner.id / 4 != 3 && corner.id / 4 != 20;
                                     return tag.x() * std::cos(angle) + tag.y() * std::sin(angle) > 0.01;
                                   }),
                    corners.end());
      ASSERT_GE(corners.size(), 8u);
    }
    const IntrinsicsOutcome intrinsics =
        solveIntrinsics(board, scene.observations, test::kCamera, Stream::kColor);
    ASSERT_EQ(intrinsics.status, IntrinsicsStatus::kSolved) << toString(intrinsics.status);
    expectNamed(intrinsics.result->views, {}, seed);
    for (int p = 0; p < 4; ++p) {
      EXPECT_LT(std::abs(intrinsics.result->camera.parameters[p] - scene.camera.parameters[p]),
                4.5 * intrinsics.result->sigma[p]);
    }
    const HandEyeOutcome outcome = solveHandEyeReprojection(
        board, intrinsics.result->camera, scene.observations, test::kCamera, Stream::kColor, {});
    ASSERT_EQ(outcome.status, HandEyeStatus::kSolved) << toString(outcome.status);
    expectNamed(outcome.solution->views, {}, seed);
    EXPECT_EQ(outcome.solution->symmetric_views, 0);
    EXPECT_LT((outcome.solution->camera_pose.translation() - scene.camera_pose.translation()).norm(), 0.003);
  }
}

}  // namespace
}  // namespace servocal::calib
