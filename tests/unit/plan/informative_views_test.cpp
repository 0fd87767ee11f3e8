// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/plan/informative_views.h"

#include <gtest/gtest.h>

#include <cmath>

#include "cells.h"
#include "fake_arm.h"
#include "joint_scene.h"
#include "servocal/calib/uncertainty.h"

namespace servocal::plan {
namespace {

constexpr double kRangeM = 0.54;

/// The default arm before two color cameras whose true poses are believed, known from three views each.
struct InformScene {
  InformScene() {
    truth.board = cell.board;
    truth.board_pose = Pose<EndEffector, Board>::fromRotationVector({0, M_PI, 0}, {0, 0, 0.06}).isometry();
    for (const double side : {-1.0, 1.0}) {
      truth.cameras.push_back({side < 0 ? "right" : "left", Stream::kColor, test::hdCamera(),
                               test::lookingAt({0.96, side * 0.51, 0.5}, {0.45, 0, 0.4})});
    }
    guard.setBoard(Pose<EndEffector, Board>(truth.board_pose));
    calib::JointOptions joint;
    joint.board.bow = false;
    std::int64_t id = 1;
    for (const test::CellCamera& camera : truth.cameras) {
      calib::JointStream stream;
      stream.camera = camera.name;
      stream.prior = calib::nominalPrior(CameraModel::fromFieldOfView(1920, 1080, 1.466));
      joint.streams.push_back(stream);
      for (const Eigen::Vector3d& lean :
           {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0.7, 0, 0), Eigen::Vector3d(0, -0.7, 0)}) {
        const auto cMo = Pose<Color, Board>::fromRotationVector(lean, {0, 0, 0.55});
        const Pose<Base, EndEffector> bMe(camera.pose * cMo.isometry() * truth.board_pose.inverse());
        observations.push_back(test::observe(truth, {bMe, {}}, id++, noise, random));
      }
    }
    solution = calib::solveJoint(cell.board, observations, joint).solution.value();
    for (std::size_t i = 0; i < solution.cameras.size(); ++i) {
      const Belief belief{solution.cameras[i].model, Pose<Base, Color>(solution.cameras[i].pose),
                          Pose<EndEffector, Board>(solution.board_pose), Mount::kFixed};
      floors.push_back(coverage::Coverage(cell.coverage, {0, 0, 1920, 1080}));
      viewers.push_back({i,
                         belief,
                         Detectability(cell.board, belief.camera),
                         nullptr,
                         {},
                         solution.cameras[i].camera,
                         true,
                         true,
                         13.0});
    }
  }

  std::optional<InformativeView> next(const calib::Forecast& forecast) const {
    return informativeView(forecast, viewers, cell.board, guard, cell.arm.start_q, options);
  }
  /// One of each of four draws.
  std::vector<InformativeView> views() {
    const calib::Forecast forecast(cell.board, solution, {cell.limits.workspace, kRangeM});
    std::vector<InformativeView> views;
    for (options.draw = 0; options.draw < 4; ++options.draw) {
      if (auto view = next(forecast)) views.push_back(*std::move(view));
    }
    return views;
  }
  /// All of the board in one of the images, with the margin.
  bool isWhole(const Pose<Base, EndEffector>& bMe) const {
    return std::any_of(viewers.begin(), viewers.end(), [&](const Viewer& viewer) {
      const auto cMo = viewer.belief.bMc.inverse() * bMe * viewer.belief.eMo;
      const auto outline = cell.board.patternOutline();
      return std::all_of(outline.begin(), outline.end(), [&](const Eigen::Vector3d& point) {
        const auto pixel = viewer.belief.camera.project(cMo * point);
        return pixel && viewer.belief.camera.contains(*pixel, viewer.image_margin_px);
      });
    });
  }
  double worstPx(const calib::JointSolution& of) const {
    double worst = 0.0;
    for (const auto& camera : of.cameras) {
      worst = std::max(worst, calib::projectionMap(of, camera, calib::Anchor::kBase, kRangeM).worst_px);
    }
    return worst;
  }

  CellConfig cell = defaultCell();
  test::Cell truth;
  test::Noise noise{0.2, 1e-4, 2.5e-4};
  std::mt19937_64 random{8};
  SimulatedClock clock;
  robot::Kinematics kinematics{cell.arm};
  test::FakeArm arm{kinematics, clock, cell.arm.start_q};
  robot::Guard guard{arm, kinematics, clock, cell.limits, cell.board};
  std::vector<Observation> observations;
  calib::JointSolution solution;
  std::vector<coverage::Coverage> floors;
  std::vector<Viewer> viewers;
  InformativeOptions options;
};

TEST(InformativeViews, AreWholeInTheImageReachableAndWhereTheySay) {
  InformScene scene;
  const auto views = scene.views();
  ASSERT_EQ(views.size(), 4u);
  for (const InformativeView& view : views) {
    const Viewer& viewer = scene.viewers[view.viewer];
    for (const Eigen::Vector3d& point : scene.cell.board.patternOutline()) {
      EXPECT_TRUE(viewer.belief.camera.contains(viewer.belief.camera.project(view.cdMo * point).value(),
                                                13.0 - 1e-6));
    }
    const auto shown = viewer.belief.bMc.inverse() * view.bMe * viewer.belief.eMo;
    EXPECT_LT(distanceM(shown, view.cdMo), 1e-9);
    const auto q = scene.kinematics.inverse(view.bMe, scene.cell.arm.start_q);
    ASSERT_TRUE(q);
    EXPECT_TRUE(scene.guard.allows(*q));
  }
}

// Twenty of them leave a third less than as many views that chance takes within reach; the same number drawn
// is the same answer.
TEST(InformativeViews, TellMoreThanViewsByChance) {
  InformScene scene;
  calib::Forecast chosen(scene.cell.board, scene.solution, {scene.cell.limits.workspace, kRangeM});
  for (scene.options.draw = 0; scene.options.draw < 20; ++scene.options.draw) {
    chosen.add(scene.next(chosen).value().stop);
  }
  calib::Forecast by_chance(scene.cell.board, scene.solution, {scene.cell.limits.workspace, kRangeM});
  int taken = 0;
  for (const test::CellStop& stop : test::randomStops(scene.truth, 400, scene.random)) {
    const auto q =
        scene.kinematics.inverse(stop.bMe, scene.cell.arm.start_q, scene.guard.limits().joint_margin_rad);
    if (taken == 20 || !q || !scene.guard.allows(*q) || !scene.isWhole(stop.bMe)) continue;
    ++taken;
    calib::PlannedStop planned{stop.bMe, {}};
    const Observation seen = test::observe(scene.truth, stop, 99, scene.noise, scene.random);
    for (const StreamObservation& view : seen.views)
      planned.looks.push_back({view.camera == "left" ? 0u : 1u, 1.0});
    by_chance.add(planned);
  }
  ASSERT_EQ(taken, 20);
  EXPECT_LT(scene.worstPx(chosen.solution()), 0.7 * scene.worstPx(by_chance.solution()));
  const auto again = scene.views(), once_more = scene.views();
  EXPECT_EQ(again.front().cdMo.translation(), once_more.front().cdMo.translation());
}

TEST(InformativeViews, DoNotRepeatWhatWasTriedNorWhatIsNotDetected) {
  InformScene scene;
  const auto first = scene.views();
  for (const InformativeView& view : first) scene.viewers[view.viewer].tried.push_back(view.cdMo);
  for (const InformativeView& view : scene.views()) {
    for (const Pose<Color, Board>& old : scene.viewers[view.viewer].tried) {
      EXPECT_TRUE(distanceM(view.cdMo, old) >= 0.03 || angleRad(view.cdMo, old) >= 0.1);
    }
  }
  // A detector that fails on all but frontal views gets frontal ones.
  std::vector<Trial> trials;
  for (int deg = 0; deg <= 60; deg += 2) {
    const double angle = deg * M_PI / 180;
    trials.push_back({Pose<Color, Board>::fromRotationVector({angle, 0, 0}, {0, 0, 0.6}), deg < 20});
    trials.push_back({Pose<Color, Board>::fromRotationVector({0, angle, 0}, {0, 0, 0.6}), deg < 20});
  }
  for (Viewer& viewer : scene.viewers) viewer.detectability.learn(trials);
  for (const InformativeView& view : scene.views()) {
    const Eigen::Vector3d sight = view.cdMo.translation().normalized();
    EXPECT_LT(std::acos(view.cdMo.rotation().col(2).dot(sight)), 30 * M_PI / 180);
  }
}

// However near it is.
TEST(InformativeViews, AreWorthAtLeastWhatIsAskedFor) {
  InformScene scene;
  const calib::Forecast forecast(scene.cell.board, scene.solution, {scene.cell.limits.workspace, kRangeM});
  const auto gain = [&] { return forecast.gains({scene.next(forecast).value().stop}).front(); };
  const double usual = gain();
  scene.options.least_worth = 1.01 * usual;
  EXPECT_GE(gain(), 1.01 * usual);
  scene.options.least_worth = 100.0;
  EXPECT_FALSE(scene.next(forecast));
}

// What a floor lacks is chosen before what tells more, if it is worth enough.
TEST(InformativeViews, ServeTheFloorOfCoverage) {
  InformScene scene;
  scene.options.floor_worth = 100.0;
  coverage::Coverage& floor = scene.floors.front();
  for (int cell = 0; cell < floor.cells(); ++cell) {
    if (cell != 20) floor.giveUp(cell);
  }
  floor.giveUpMarginals();
  scene.viewers.front().floor = &floor;
  const auto views = scene.views();
  int serving = 0;
  for (const InformativeView& view : views) {
    const auto cMo = scene.viewers.front().belief.bMc.inverse() * view.bMe * scene.viewers.front().belief.eMo;
    std::vector<Eigen::Vector2d> pixels;
    for (const Eigen::Vector3d& corner : scene.cell.board.corners()) {
      if (const auto pixel = scene.viewers.front().belief.camera.project(cMo * corner))
        pixels.push_back(*pixel);
    }
    serving += floor.missingCorners(pixels) > 0;
  }
  EXPECT_EQ(serving, static_cast<int>(views.size()));
}

TEST(Detectability, BeginsWithWhatIsSupposedAndLearns) {
  const CellConfig cell = test::oneCameraCell();
  Detectability detectability(cell.board, CameraModel::fromFieldOfView(1920, 1080, 1.466));
  const auto leaning = [](double deg) {
    return Pose<Color, Board>::fromRotationVector({deg * M_PI / 180, 0, 0}, {0, 0, 0.8});
  };
  EXPECT_GT(detectability.probability(leaning(0)), 0.95);
  EXPECT_GT(detectability.probability(leaning(45)), 0.95);  // Squares of 28 px.
  EXPECT_LT(detectability.probability(leaning(72)), 0.4);
  std::vector<Trial> trials;
  for (double deg = 0; deg < 84; deg += 4) trials.push_back({leaning(deg), deg < 70});
  detectability.learn(trials);
  EXPECT_GT(detectability.probability(leaning(62)), 0.8);
  EXPECT_LT(detectability.probability(leaning(78)), 0.2);
  detectability.learn({});
  EXPECT_LT(detectability.probability(leaning(72)), 0.4);
}

}  // namespace
}  // namespace servocal::plan
