// SPDX-License-Identifier: GPL-3.0-or-later
// Stops that are forecast against the covariance that a solve would claim once they have been made.
#include "servocal/calib/forecast.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "joint_scene.h"
#include "servocal/calib/uncertainty.h"

namespace servocal::calib {
namespace {

const Box kWorkspace{"", {0.2, -0.4, 0.2}, {0.9, 0.4, 0.7}};
const test::Noise kNoise{0.2, 1e-4, 2.5e-4};

struct ForecastScene {
  explicit ForecastScene(Mount mount = Mount::kFixed) : cell(test::makeCell(3, 2, mount)) {
    JointOptions options;
    options.mount = mount;
    options.board.bow = false;
    stops = test::randomStops(cell, 48, random);
    const auto all = test::observeAll(cell, stops, kNoise, random);
    made.assign(all.begin(), all.begin() + 24);
    to_come.assign(all.begin() + 24, all.end());
    const JointSolution solved = solveJoint(cell.board, made, options).solution.value();
    at = test::truthLike(solved, cell, kNoise);
    for (JointCamera& camera : at.cameras) camera.rms_px = std::sqrt(2.0) * kNoise.corner_px;
    at.covariance = jointCovarianceAt(cell.board, made, at);
  }

  /// What the observation will be, before it is made.
  PlannedStop planned(const Observation& observation) const {
    PlannedStop stop;
    stop.bMe = observation.robot->bMe;
    for (const StreamObservation& view : observation.views) {
      for (std::size_t k = 0; k < at.cameras.size(); ++k) {
        if (at.cameras[k].camera == view.camera && at.cameras[k].stream == view.stream)
          stop.looks.push_back({k, 1.0});
      }
    }
    return stop;
  }

  std::mt19937_64 random{4};
  test::Cell cell;
  std::vector<test::CellStop> stops;
  std::vector<Observation> made, to_come;
  JointSolution at;
};

double worstRatio(const Eigen::MatrixXd& first, const Eigen::MatrixXd& second) {
  const Eigen::ArrayXd ratio = (first.diagonal().array() / second.diagonal().array()).sqrt();
  return std::max(ratio.maxCoeff(), 1.0 / ratio.minCoeff());
}

class ForecastOf : public testing::TestWithParam<Mount> {};

// The robot's poses are those of the plan, the lens that of before: first order.
TEST_P(ForecastOf, StopsLeavesWhatASolveWouldClaim) {
  const ForecastScene scene(GetParam());
  Forecast forecast(scene.cell.board, scene.at, {kWorkspace, 0.6});
  std::vector<Observation> all = scene.made;
  for (const Observation& observation : scene.to_come) {
    forecast.add(scene.planned(observation));
    all.push_back(observation);
  }
  const Eigen::MatrixXd claimed = jointCovarianceAt(scene.cell.board, all, scene.at);
  EXPECT_LT(worstRatio(forecast.solution().covariance, claimed), 1.02);
  EXPECT_GT(worstRatio(scene.at.covariance, claimed), 1.3);  // The stops did tell something.
}

INSTANTIATE_TEST_SUITE_P(Mounts, ForecastOf, testing::Values(Mount::kFixed, Mount::kFlange),
                         [](const auto& mount) { return mount.param == Mount::kFixed ? "Fixed" : "Flange"; });

/// log of the mean variances before over after, by the maps.
double gainByMaps(const JointSolution& before, const JointSolution& after) {
  double gain = 0.0;
  for (std::size_t k = 0; k < before.cameras.size(); ++k) {
    const auto variance = [&](const JointSolution& solution) {
      const JointCamera& camera = solution.cameras[k];
      return std::pow(projectionMap(solution, camera, Anchor::kBase, 0.6).rms_px, 2);
    };
    const auto points = [&](const JointSolution& solution) {
      return std::pow(workspaceMap(solution, solution.cameras[k], kWorkspace).rms_m, 2);
    };
    gain += std::log(variance(before) / variance(after)) + std::log(points(before) / points(after));
  }
  return gain;
}

// What is ranked by is not what the maps say (they weigh every place alike), but the better stop is the
// better one.
TEST(Forecast, GainRanksStopsAsTheMapsDo) {
  const ForecastScene scene;
  std::vector<PlannedStop> stops;
  for (const Observation& observation : scene.to_come) stops.push_back(scene.planned(observation));
  const Forecast forecast(scene.cell.board, scene.at, {kWorkspace, 0.6});
  const std::vector<double> gains = forecast.gains(stops);
  ASSERT_EQ(gains.size(), stops.size());
  std::vector<double> by_maps;
  for (const Observation& observation : scene.to_come) {
    std::vector<Observation> all = scene.made;
    all.push_back(observation);
    JointSolution after = scene.at;
    after.covariance = jointCovarianceAt(scene.cell.board, all, scene.at);
    by_maps.push_back(gainByMaps(scene.at, after));
  }
  int agreeing = 0, pairs = 0;
  for (std::size_t i = 0; i < gains.size(); ++i) {
    EXPECT_GT(gains[i], 0.0);
    for (std::size_t j = 0; j < i; ++j) {
      ++pairs;
      agreeing += (gains[i] > gains[j]) == (by_maps[i] > by_maps[j]);
    }
  }
  EXPECT_GT(agreeing, 0.85 * pairs);
}

TEST(Forecast, ALookThatIsNotLikelyTellsLess) {
  const ForecastScene scene;
  const Forecast forecast(scene.cell.board, scene.at, {kWorkspace, 0.6});
  PlannedStop sure = scene.planned(scene.to_come.front()), half = sure, never = sure;
  for (auto& look : half.looks) look.probability = 0.5;
  for (auto& look : never.looks) look.probability = 0.0;
  const std::vector<double> gains = forecast.gains({sure, half, never, PlannedStop{sure.bMe, {}}});
  EXPECT_GT(gains[0], 1.1 * gains[1]);
  EXPECT_GT(gains[1], 0.0);
  EXPECT_NEAR(gains[2], 0.0, 1e-9);
  EXPECT_EQ(gains[3], 0.0);
}

TEST(Forecast, RefusesWhatItCannotForecast) {
  ForecastScene scene;
  scene.at.robot_terms = Eigen::VectorXd::Zero(1);
  EXPECT_THROW(Forecast(scene.cell.board, scene.at, {kWorkspace, 0.6}), std::invalid_argument);
  scene.at.robot_terms.resize(0);
  scene.at.covariance(0, 0) = NAN;
  EXPECT_THROW(Forecast(scene.cell.board, scene.at, {kWorkspace, 0.6}), std::invalid_argument);
}

// Both halves are drawn with the noise that is claimed, so what they differ by is what they claim.
TEST(CompareHalves, DifferByWhatTheyClaimUnlessTheModelIsWrong) {
  ForecastScene scene;
  JointOptions options;
  options.board.bow = false;
  std::vector<Observation> all = scene.made;
  all.insert(all.end(), scene.to_come.begin(), scene.to_come.end());
  const auto meanRatio = [&] {
    const JointSolution solution = solveJoint(scene.cell.board, all, options).solution.value();
    double squares = 0.0;
    for (const auto& halves : compareHalves(scene.cell.board, all, options, solution)) {
      squares += std::pow(halves.value().rms_px / halves->claimed_px, 2) /
                 static_cast<double>(solution.cameras.size());
    }
    return std::sqrt(squares);
  };
  const double right = meanRatio();
  EXPECT_GT(right, 0.3);
  EXPECT_LT(right, 1.6);
  // A lens without distortion is not this one's.
  for (const test::CellCamera& camera : scene.cell.cameras) {
    JointStream stream;
    stream.camera = camera.name;
    stream.stream = camera.stream;
    stream.fixed = {"k1", "k2", "p1", "p2", "k3"};
    options.streams.push_back(stream);
  }
  EXPECT_GT(meanRatio(), 2.0);
}

TEST(CompareHalves, NothingOfTooFewStops) {
  const ForecastScene scene;
  const std::vector<Observation> few(scene.made.begin(), scene.made.begin() + 3);
  for (const auto& halves : compareHalves(scene.cell.board, few, {}, scene.at)) EXPECT_FALSE(halves);
}

}  // namespace
}  // namespace servocal::calib
