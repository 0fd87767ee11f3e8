// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/board_places.h"

#include <gtest/gtest.h>

#include "joint_scene.h"

namespace servocal::calib {
namespace {

struct Solved {
  test::Cell cell = test::makeCell(6);
  std::vector<test::CellStop> stops;
  std::vector<Observation> observations;
  JointSolution solution;
  const JointCamera& infrared() const { return solution.cameras[1]; }
};

Solved solved(std::uint64_t seed = 2) {
  Solved out;
  std::mt19937_64 random(seed);
  out.stops = test::randomStops(out.cell, 30, random);
  out.observations = test::observeAll(out.cell, out.stops, {0.2, 1e-4, 2.5e-4}, random);
  out.solution = solveJoint(out.cell.board, out.observations).solution.value();
  return out;
}

/// Mean over the views of the depth of the board's plane along the ray to its middle.
double meanDepthM(const Solved& s, const BoardPlaces& places, const BoardPlaces& rays) {
  Eigen::Vector3d middle_o = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& corner : s.cell.board.corners())
    middle_o += corner / s.cell.board.cornerCount();
  double sum = 0.0;
  for (const auto& [id, cMo] : places.poses) {
    const Eigen::Vector3d ray = (rays.poses.at(id) * middle_o).hnormalized().homogeneous();
    const Eigen::Vector3d normal = cMo.linear().col(2);
    sum += normal.dot(cMo * middle_o) / normal.dot(ray);
  }
  return sum / static_cast<double>(places.poses.size());
}

TEST(BoardPlaces, AreWhereTheBoardWas) {
  const Solved s = solved();
  const BoardPlaces places = boardPlaces(s.cell.board, s.observations, s.solution, s.infrared());
  ASSERT_GT(places.poses.size(), 20u);
  std::vector<double> off_m;
  double mean_m = 0.0, squares_m2 = 0.0;
  for (const auto& [id, cMo] : places.poses) {
    const Eigen::Isometry3d truth =
        test::trueBoardInCamera(s.cell, s.cell.cameras[1], s.stops[static_cast<std::size_t>(id) - 1].bMe);
    off_m.push_back((cMo.translation() - truth.translation()).z());
    mean_m += off_m.back() / static_cast<double>(places.poses.size());
  }
  for (const double off : off_m) squares_m2 += std::pow(off - mean_m, 2) / static_cast<double>(off_m.size());
  std::cout << "off by " << 1e3 * mean_m << " mm in common, scattered by " << 1e3 * std::sqrt(squares_m2)
            << "; claimed " << 1e3 * places.common_m << ", per stop " << 1e3 * places.sigma_m << '\n';
  // What turns of camera and mount do is not the same in all views: part of the scatter, but no error of a stop.
  EXPECT_LT(std::abs(mean_m), 3.5 * places.common_m);
  EXPECT_LT(std::sqrt(squares_m2), 2.0 * places.common_m);
  EXPECT_LT(places.sigma_m, 1e-4);  // Better than the robot is.
}

TEST(BoardPlaces, HoldEachStopsCorrection) {
  const Solved s = solved();
  const BoardPlaces places = boardPlaces(s.cell.board, s.observations, s.solution, s.infrared());
  Solved believing = s;
  for (StopCorrection& stop : believing.solution.stops) stop.correction.setZero();
  const BoardPlaces by_robot =
      boardPlaces(s.cell.board, s.observations, believing.solution, believing.infrared());
  double squares_m2 = 0.0;
  for (const auto& [id, cMo] : places.poses)
    squares_m2 += (cMo.translation() - by_robot.poses.at(id).translation()).squaredNorm();
  const double rms_m = std::sqrt(squares_m2 / static_cast<double>(3 * places.poses.size()));
  EXPECT_NEAR(rms_m, 1e-4, 0.5e-4);  // The robot's noise.
}

TEST(BoardPlaces, LeaveOutWhatTheSolutionDid) {
  Solved s = solved();
  ViewResidual& view = s.solution.cameras[1].views.front();
  ASSERT_TRUE(view.used);
  view.used = false;
  const BoardPlaces places = boardPlaces(s.cell.board, s.observations, s.solution, s.infrared());
  EXPECT_EQ(places.poses.count(view.observation_id), 0u);
  EXPECT_GT(places.poses.size(), 20u);
}

// Poses of camera and board uncertain along one direction at a time: what the plane moves by if both go along it.
TEST(BoardPlaces, CommonErrorIsWhatThePosesDoToTheDepth) {
  const Solved s = solved();
  const BoardPlaces places = boardPlaces(s.cell.board, s.observations, s.solution, s.infrared());
  constexpr double kStep = 1e-6;
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  for (int draw = 0; draw < 8; ++draw) {
    Solved moved = s, uncertain = s;
    Eigen::VectorXd direction = Eigen::VectorXd::Zero(s.solution.covariance.rows());
    const auto go = [&](Eigen::Isometry3d& pose, int at) {
      for (int i = 0; i < 6; ++i) direction[at + i] = normal(random);
      const Eigen::Vector3d turn = direction.segment<3>(at + 3);
      pose.translation() += kStep * direction.segment<3>(at);
      pose.linear() = Eigen::AngleAxisd(kStep * turn.norm(), turn.normalized()) * pose.linear();
    };
    go(moved.solution.cameras[1].pose, s.infrared().pose_at);
    go(moved.solution.board_pose, s.solution.board_at);
    const BoardPlaces there = boardPlaces(s.cell.board, s.observations, moved.solution, moved.infrared());
    const double by_motion = std::abs(meanDepthM(s, there, places) - meanDepthM(s, places, places)) / kStep;
    uncertain.solution.covariance = direction * direction.transpose();
    const BoardPlaces claimed =
        boardPlaces(s.cell.board, s.observations, uncertain.solution, uncertain.infrared());
    EXPECT_NEAR(claimed.common_m, by_motion, 1e-4);
  }
}

}  // namespace
}  // namespace servocal::calib
