// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/board_places.h"

#include <cmath>

#include "joint_prediction.h"
#include "se3.h"

namespace servocal::calib {
namespace {

using Row12d = Eigen::Matrix<double, 1, 12>;

Eigen::Vector3d boardCenter(const BoardSpec& board) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& corner : board.corners()) sum += corner;
  return sum / board.cornerCount();
}

/// Derivative of the depth of the board's plane, along the ray to its center, by the pose of the camera and
/// that of the board, as JointSolution::names moves them.
Row12d depthByPoses(const JointSolution& solution, const JointCamera& camera, const Eigen::Isometry3d& cMo,
                    const Eigen::Vector3d& center_o) {
  const Eigen::Vector3d center_c = cMo * center_o;
  const Eigen::Matrix3d cRl = camera.pose.linear().transpose();
  const Eigen::Matrix3d cRr = cMo.linear() * solution.board_pose.linear().transpose();
  Eigen::Matrix<double, 3, 12> center;
  center << -cRl * pointByMotion(camera.pose.linear() * center_c),
      cRr * pointByMotion(solution.board_pose.linear() * center_o);
  const Eigen::RowVector3d normal = cMo.linear().col(2).transpose();
  return normal * center / normal.dot(center_c / center_c.z());
}

}  // namespace

BoardPlaces boardPlaces(const BoardSpec& board, const std::vector<Observation>& observations,
                        const JointSolution& solution, const JointCamera& camera) {
  JointPrediction prediction(board, observations, solution);
  prediction.restore(solution);
  const JointProblem& problem = prediction.problem();
  BoardPlaces places;
  Row12d depth_by_poses = Row12d::Zero();
  for (const JointView& view : problem.views()) {
    const JointCamera& seen_by = solution.cameras[view.camera];
    if (seen_by.camera != camera.camera || seen_by.stream != camera.stream) continue;
    const Eigen::Isometry3d cMo =
        problem.boardPose(prediction.state(), view, problem.correction(prediction.state(), view.stop));
    places.poses.emplace(problem.stops()[view.stop].observation->id, cMo);
    depth_by_poses += depthByPoses(solution, camera, cMo, boardCenter(board));
  }
  if (places.poses.empty()) return places;
  depth_by_poses /= static_cast<double>(places.poses.size());

  double squares_m2 = 0.0, squares_rad2 = 0.0, axes = 0.0;
  for (const StopCorrection& stop : solution.stops) {
    if (places.poses.count(stop.observation_id) == 0) continue;
    squares_m2 += stop.sigma.head<3>().squaredNorm();
    squares_rad2 += stop.sigma.tail<3>().squaredNorm();
    axes += 3.0;
  }
  places.sigma_m = std::sqrt(squares_m2 / axes);
  places.sigma_rad = std::sqrt(squares_rad2 / axes);

  Eigen::Matrix<double, 12, 12> covariance;
  const int at[] = {camera.pose_at, solution.board_at};
  for (int row = 0; row < 2; ++row) {
    for (int column = 0; column < 2; ++column)
      covariance.block<6, 6>(6 * row, 6 * column) = solution.covariance.block<6, 6>(at[row], at[column]);
  }
  places.common_m = std::sqrt(depth_by_poses * covariance * depth_by_poses.transpose());
  return places;
}

}  // namespace servocal::calib
