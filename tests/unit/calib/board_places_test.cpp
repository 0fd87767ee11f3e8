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
  double squares_m2 = 0.0;
  for (const auto& [id, cMo] : places.poses) {
    const Eigen::Isometry3d truth =
        test::trueBoardInCamera(s.cell, s.cell.cameras[1], s.stops[static_cast<std::size_t>(id) - 1].bMe);
    squares_m2 += std::pow((cMo.translation() - truth.translation()).z(), 2);
  }
  const double rms_m = std::sqrt(squares_m2 / static_cast<double>(places.poses.size()));
  EXPECT_LT(rms_m, 4.0 * std::hypot(places.sigma_m, places.common_m));
  EXPECT_GT(places.sigma_m, 1e-5);
  EXPECT_LT(places.sigma_m, 1e-4);  // better than the robot says it is
  std::cout << "off by " << 1e3 * rms_m << " mm, claimed " << 1e3 * places.sigma_m << " per stop, "
            << 1e3 * places.common_m << " in common\n";
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

// One parameter uncertain after the other: what the plane moves by if that parameter does.
TEST(BoardPlaces, CommonErrorIsWhatThePosesDoToTheDepth) {
  Solved s = solved();
  const BoardPlaces places = boardPlaces(s.cell.board, s.observations, s.solution, s.infrared());
  constexpr double kStep = 1e-6;
  for (const int first : {s.infrared().pose_at, s.solution.board_at}) {
    for (int i = 0; i < 6; ++i) {
      Solved moved = s;
      Eigen::Isometry3d& pose =
          first == s.solution.board_at ? moved.solution.board_pose : moved.solution.cameras[1].pose;
      if (i < 3) {
        pose.translation()[i] += kStep;
      } else {
        pose.linear() = Eigen::AngleAxisd(kStep, Eigen::Vector3d::Unit(i - 3)) * pose.linear();
      }
      const BoardPlaces there = boardPlaces(s.cell.board, s.observations, moved.solution, moved.infrared());
      const double by_motion = std::abs(meanDepthM(s, there, places) - meanDepthM(s, places, places)) / kStep;
      Solved uncertain = s;
      uncertain.solution.covariance.setZero();
      uncertain.solution.covariance(first + i, first + i) = 1.0;
      const double claimed =
          boardPlaces(s.cell.board, s.observations, uncertain.solution, uncertain.infrared()).common_m;
      EXPECT_NEAR(claimed, by_motion, 1e-4) << s.solution.names[static_cast<std::size_t>(first + i)];
    }
  }
}

}  // namespace
}  // namespace servocal::calib
