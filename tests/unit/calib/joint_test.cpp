// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/joint.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <ctime>

#include "joint_scene.h"
#include "joint_spread.h"

namespace servocal::calib {
namespace {

double cpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

struct Draw {
  test::Cell cell;
  std::vector<test::CellStop> stops;
  std::vector<Observation> observations;
};

Draw drawCell(std::uint64_t seed, int stops, const test::Noise& noise, int kinects = 1,
              Mount mount = Mount::kFixed, const BoardShape& shape = {}) {
  std::mt19937_64 random(seed);
  Draw draw{test::makeCell(seed, kinects, mount), {}, {}};
  draw.cell.shape = shape;
  draw.stops = test::randomStops(draw.cell, stops, random);
  draw.observations = test::observeAll(draw.cell, draw.stops, noise, random);
  return draw;
}

JointOptions optionsOf(const test::Cell& cell) {
  JointOptions options;
  options.mount = cell.mount;
  return options;
}

const test::Noise kUsual{0.2, 1e-4, 2.5e-4};

TEST(SolveJoint, RecoversTruthWithoutNoise) {
  for (const Mount mount : {Mount::kFixed, Mount::kFlange}) {
    const Draw draw = drawCell(3, 24, {}, 1, mount);
    const JointOutcome outcome = solveJoint(draw.cell.board, draw.observations, optionsOf(draw.cell));
    ASSERT_EQ(outcome.status, JointStatus::kSolved) << toString(outcome.status);
    const JointSolution& solution = *outcome.solution;
    ASSERT_EQ(solution.cameras.size(), 2u);
    const Eigen::VectorXd errors = test::errorsOf(solution, draw.cell);
    for (Eigen::Index i = 0; i < errors.size(); ++i) {
      EXPECT_LT(std::abs(errors[i]), 1e-4 * solution.sigma[i]) << solution.names[static_cast<std::size_t>(i)];
    }
    for (const JointCamera& camera : solution.cameras) {
      EXPECT_LT(std::abs(camera.model.fx() - (camera.stream == Stream::kColor ? 1066.0 : 366.0)), 1e-5);
      EXPECT_LT(camera.rms_px, 1e-5);
      for (const ViewResidual& view : camera.views) EXPECT_TRUE(view.used) << view.reason;
    }
    EXPECT_LT((solution.board_pose.translation() - draw.cell.board_pose.translation()).norm(), 1e-8);
  }
}

// A dozen seeds; two hundred in the nightly test.
TEST(SolveJoint, ClaimsTheSpreadItHas) {
  for (const Mount mount : {Mount::kFixed, Mount::kFlange}) {
    test::SpreadCase usual;
    usual.mount = mount;
    const test::Spread spread = test::spreadOf(usual, 12);
    EXPECT_LT(spread.chi_square, test::chiSquareQuantile(spread.degrees, 2.576));
    EXPECT_GT(spread.chi_square, test::chiSquareQuantile(spread.degrees, -2.576));
    for (std::size_t g = 0; g < spread.groups.size(); ++g) {
      EXPECT_GT(spread.spread_over_claim[g], 0.7) << spread.groups[g];
      EXPECT_LT(spread.spread_over_claim[g], 1.3) << spread.groups[g];
      EXPECT_LT(spread.error_over_bound[g], 1.3) << spread.groups[g];
    }
  }
}

// The paper's printed board: 3 % small, not quite square, and bowed by 0.4 mm.
TEST(SolveJoint, FindsAWrongSquareSizeAndABow) {
  const BoardShape shape{0.970, 0.9715, 4e-4, -1e-4};
  const Draw draw = drawCell(11, 40, kUsual, 1, Mount::kFixed, shape);
  const JointOutcome outcome = solveJoint(draw.cell.board, draw.observations, optionsOf(draw.cell));
  ASSERT_EQ(outcome.status, JointStatus::kSolved) << toString(outcome.status);
  const JointSolution& solution = *outcome.solution;
  const Eigen::VectorXd errors = test::errorsOf(solution, draw.cell);
  for (Eigen::Index i = 0; i < errors.size(); ++i) {
    EXPECT_LT(std::abs(errors[i]), 4 * solution.sigma[i]) << solution.names[static_cast<std::size_t>(i)];
  }
  EXPECT_LT(solution.sigma[solution.shape_at], 5e-4);
  EXPECT_LT(solution.sigma[solution.shape_at + 2], 1.5e-4);
  for (const JointCamera& camera : solution.cameras) {
    for (const ViewResidual& view : camera.views) EXPECT_TRUE(view.used) << view.reason;
  }
  std::cout << "scale " << solution.board.scale_x << " +- " << solution.sigma[solution.shape_at] << ", bow "
            << 1e3 * solution.board.bow_x_m << " +- " << 1e3 * solution.sigma[solution.shape_at + 2]
            << " mm\n";
}

// An arm that only spins about one axis cannot tell where the cameras are along it.
TEST(SolveJoint, RefusesASingleAxis) {
  Draw draw = drawCell(7, 1, {});
  std::mt19937_64 random(1);
  std::vector<test::CellStop> stops;
  for (int i = 0; i < 14; ++i) {
    const auto turn =
        Pose<EndEffector, EndEffector>::fromRotationVector({0, 0, 0.06 * i}, {0.004 * i, -0.002 * i, 0});
    stops.push_back({draw.stops[0].bMe * turn, {}});
  }
  const auto observations = test::observeAll(draw.cell, stops, kUsual, random);
  JointOptions options = optionsOf(draw.cell);
  for (const test::CellCamera& camera : draw.cell.cameras) {
    options.streams.emplace_back();
    options.streams.back().camera = camera.name;
    options.streams.back().stream = camera.stream;
    options.streams.back().prior = nominalPrior(camera.model);
  }
  const JointOutcome outcome = solveJoint(draw.cell.board, observations, options);
  EXPECT_EQ(outcome.status, JointStatus::kRotationAxesParallel) << toString(outcome.status);
  EXPECT_FALSE(outcome.solution.has_value());

  // The same, the closed form told to let it pass: the analysis of what is open says it too.
  options.closed_form.min_axis_spread = 0;
  options.closed_form.min_rotation_rad = 0;
  const JointOutcome passed = solveJoint(draw.cell.board, observations, options);
  EXPECT_NE(passed.status, JointStatus::kSolved);
  EXPECT_FALSE(passed.solution.has_value());
  if (passed.status == JointStatus::kNotDetermined) {
    ASSERT_FALSE(passed.open.empty());
    EXPECT_NE(passed.open[0].sentence.find("rotate"), std::string::npos) << passed.open[0].sentence;
  }
}

// Every camera's board is in the image's middle and far away: the lens's edge is not seen. What is open is
// named, nothing is claimed for it.
TEST(SolveJoint, NamesADistortionTheViewsDoNotShow) {
  std::mt19937_64 random(4);
  const test::Cell cell = test::makeCell(4, 1, Mount::kFixed, false);
  std::vector<test::CellStop> stops;
  const CameraModel& model = cell.cameras[0].model;
  test::SceneOptions options;
  options.near_m = 0.7;
  options.far_m = 1.0;
  while (stops.size() < 25) {
    const test::CellStop stop = test::randomStops(cell, 1, random, options).front();
    const Eigen::Isometry3d cMo = test::trueBoardInCamera(cell, cell.cameras[0], stop.bMe);
    const auto middle = model.project(cMo.translation());
    if (middle && (*middle - Eigen::Vector2d(955, 545)).norm() < 130) stops.push_back(stop);
  }
  const auto observations = test::observeAll(cell, stops, kUsual, random);
  const JointOutcome outcome = solveJoint(cell.board, observations, optionsOf(cell));
  ASSERT_EQ(outcome.status, JointStatus::kSolved) << toString(outcome.status);
  const JointSolution& solution = *outcome.solution;
  ASSERT_FALSE(solution.open.empty());
  EXPECT_NE(solution.open[0].sentence.find("distortion of k1 color"), std::string::npos)
      << solution.open[0].sentence;
  EXPECT_TRUE(std::isnan(solution.sigma[8])) << solution.names[8];
  EXPECT_FALSE(std::isnan(solution.sigma[0]));
}

// A third of the stops lie: foreign robot poses, shifted detections, in any order.
TEST(SolveJoint, SurvivesWrongViewsInAnyOrder) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    Draw draw = drawCell(20 + seed, 40, kUsual);
    std::vector<bool> bad(40, false);
    for (std::size_t i = 0; i < 12; ++i) {
      const std::size_t at = (3 * i + seed) % 40;
      bad[at] = true;
      if (i % 2 == 0) {
        draw.observations[at].robot->bMe = draw.stops[(at + 17) % 40].bMe;
      } else {
        for (StreamObservation& view : draw.observations[at].views) {
          for (Corner& corner : view.detection.corners) corner.pixel.x() += 30.0;
        }
      }
    }
    const JointOutcome first = solveJoint(draw.cell.board, draw.observations, optionsOf(draw.cell));
    ASSERT_EQ(first.status, JointStatus::kSolved) << toString(first.status);
    for (const JointCamera& camera : first.solution->cameras) {
      for (const ViewResidual& view : camera.views) {
        EXPECT_EQ(view.used, !bad[static_cast<std::size_t>(view.observation_id) - 1])
            << camera.camera << view.observation_id << ": " << view.reason;
        EXPECT_EQ(view.reason.empty(), view.used);
      }
    }
    const Eigen::VectorXd errors = test::errorsOf(*first.solution, draw.cell);
    const Eigen::VectorXd z = errors.cwiseQuotient(first.solution->sigma);
    EXPECT_LT(z.cwiseAbs().maxCoeff(), 5.0);

    std::mt19937_64 random(seed);
    std::shuffle(draw.observations.begin(), draw.observations.end(), random);
    const JointOutcome second = solveJoint(draw.cell.board, draw.observations, optionsOf(draw.cell));
    ASSERT_TRUE(second.solution.has_value());
    EXPECT_EQ(test::errorsOf(*second.solution, draw.cell), errors);  // to the last bit
    EXPECT_EQ(second.solution->covariance, first.solution->covariance);
  }
}

// One camera of two errs at a stop: its view goes, the other's stays.
TEST(SolveJoint, BlamesTheImageOrTheRobot) {
  Draw draw = drawCell(31, 30, kUsual);
  int wrong_image = -1;
  for (std::size_t i = 5; i < 30 && wrong_image < 0; ++i) {
    if (draw.observations[i].views.size() == 2) wrong_image = static_cast<int>(i);
  }
  ASSERT_GE(wrong_image, 0);
  Observation& observation = draw.observations[static_cast<std::size_t>(wrong_image)];
  for (Corner& corner : observation.views[1].detection.corners) corner.pixel.y() += 3.0;
  const JointOutcome outcome = solveJoint(draw.cell.board, draw.observations, optionsOf(draw.cell));
  ASSERT_EQ(outcome.status, JointStatus::kSolved);
  for (const JointCamera& camera : outcome.solution->cameras) {
    for (const ViewResidual& view : camera.views) {
      const bool bad = view.observation_id == observation.id && camera.stream == observation.views[1].stream;
      EXPECT_EQ(view.used, !bad) << camera.camera << ' ' << toString(camera.stream) << ' '
                                 << view.observation_id;
    }
  }
}

// Told a tenth of the robot's noise, or ten times it: found all the same, and said.
TEST(SolveJoint, CorrectsAMisSetRobotNoise) {
  const test::Noise noise{0.2, 5e-4, 1e-3};
  const Draw draw = drawCell(41, 50, noise);
  for (const double factor : {0.1, 1.0, 10.0}) {
    JointOptions options = optionsOf(draw.cell);
    options.robot_sigma_m = factor * noise.robot_m;
    options.robot_sigma_rad = factor * noise.robot_rad;
    const JointOutcome outcome = solveJoint(draw.cell.board, draw.observations, options);
    ASSERT_EQ(outcome.status, JointStatus::kSolved) << toString(outcome.status);
    const RobotNoise& robot = outcome.solution->robot;
    std::cout << "declared x " << factor << ": " << 1e3 * robot.sigma_m << " mm (" << robot.degrees_m
              << " dof), " << 1e3 * robot.sigma_rad << " mrad (" << robot.degrees_rad << " dof)\n";
    EXPECT_NEAR(robot.sigma_m / noise.robot_m, 1.0, 4.0 / std::sqrt(2 * robot.degrees_m));
    EXPECT_NEAR(robot.sigma_rad / noise.robot_rad, 1.0, 4.0 / std::sqrt(2 * robot.degrees_rad));
    EXPECT_EQ(outcome.solution->notes.empty(), factor == 1.0);
    const Eigen::VectorXd z =
        test::errorsOf(*outcome.solution, draw.cell).cwiseQuotient(outcome.solution->sigma);
    EXPECT_LT(z.cwiseAbs().maxCoeff(), 4.5);
  }
}

TEST(SolveJoint, FindsTheNoiseOfEachStream) {
  Draw draw = drawCell(51, 50, kUsual);
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal(0.0, 0.3);
  for (Observation& observation : draw.observations) {
    for (StreamObservation& view : observation.views) {
      if (view.stream != Stream::kInfrared) continue;
      for (Corner& corner : view.detection.corners)
        corner.pixel += Eigen::Vector2d(normal(random), normal(random));
    }
  }
  const JointOutcome outcome = solveJoint(draw.cell.board, draw.observations, optionsOf(draw.cell));
  ASSERT_EQ(outcome.status, JointStatus::kSolved);
  EXPECT_NEAR(outcome.solution->cameras[0].corner_scale, 0.2 / std::hypot(0.2, 0.03), 0.05);
  EXPECT_NEAR(outcome.solution->cameras[1].corner_scale, std::hypot(0.2, 0.3) / std::hypot(0.2, 0.03), 0.1);
}

TEST(SolveJoint, RefusesTooFewViewsAndACallersMistakes) {
  Draw draw = drawCell(61, 12, kUsual);
  JointOptions options = optionsOf(draw.cell);
  for (std::size_t i = 2; i < 12; ++i) draw.observations[i].robot.reset();
  EXPECT_EQ(solveJoint(draw.cell.board, draw.observations, options).status, JointStatus::kTooFewViews);
  EXPECT_EQ(solveJoint(draw.cell.board, {}, options).status, JointStatus::kTooFewViews);
  options.robot_sigma_m = 0;
  EXPECT_THROW((void)solveJoint(draw.cell.board, draw.observations, options), std::invalid_argument);
  options = optionsOf(draw.cell);
  options.streams.emplace_back();
  options.streams.back().camera = "k1";
  options.streams.back().fixed = {"k9"};
  EXPECT_THROW((void)solveJoint(draw.cell.board, draw.observations, options), std::invalid_argument);
  draw.observations[1].robot->bMe = Pose<Base, EndEffector>();
  EXPECT_THROW((void)solveJoint(draw.cell.board, draw.observations, optionsOf(draw.cell)),
               std::invalid_argument);
}

// The product's final solve: 200 stops, three RGB-D cameras, with covariance; 3 s are the budget.
TEST(SolveJoint, IsFastEnough) {
  const Draw draw = drawCell(71, 200, kUsual, 3);
  const double start = cpuSeconds();
  const JointOutcome outcome = solveJoint(draw.cell.board, draw.observations, optionsOf(draw.cell));
  const double seconds = cpuSeconds() - start;
  ASSERT_EQ(outcome.status, JointStatus::kSolved) << toString(outcome.status);
  std::size_t views = 0;
  for (const JointCamera& camera : outcome.solution->cameras) views += camera.views.size();
  std::cout << "200 stops, " << views << " views, " << outcome.solution->names.size()
            << " parameters: " << seconds << " s of CPU time\n";
#if defined(__OPTIMIZE__) && !defined(__SANITIZE_ADDRESS__)
  EXPECT_LT(seconds, 3.0);
#endif
}

}  // namespace
}  // namespace servocal::calib
