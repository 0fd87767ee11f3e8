// SPDX-License-Identifier: GPL-3.0-or-later
#include "check_prior.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include "servocal/procedure/check.h"

namespace servocal::procedure {
namespace {

constexpr double kCornerPx = 0.1;  // Far less than the robot's error in the image: its size does not matter.

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

}  // namespace

Eigen::MatrixXd poseByIntrinsics(const BoardSpec& board, const CameraModel& camera,
                                 const HandEyeSolution& hand_eye, double near_distance_m,
                                 const Eigen::Matrix<double, 6, 1>& robot_sigma) {
  const auto p = static_cast<int>(camera.parameters.size());
  const Eigen::Isometry3d &bMc = hand_eye.camera_pose, &eMo = hand_eye.board_pose;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(12 + p, 12 + p);  // camera, board, intrinsics
  for (const Pose<Color, Board>& cMo : checkViews(camera, near_distance_m)) {
    const Eigen::Matrix3d bRe = bMc.linear() * cMo.rotation() * eMo.linear().transpose();
    Eigen::MatrixXd view = Eigen::MatrixXd::Zero(18 + p, 18 + p);  // the same, and the robot's error
    for (const Eigen::Vector3d& point_o : board.corners()) {
      const Eigen::Vector3d point_c = cMo * point_o;
      ProjectionJacobian by;
      if (!camera.project(point_c, by)) continue;
      const Eigen::Matrix<double, 2, 3> by_b = by.point * bMc.linear().transpose(), by_e = by_b * bRe;
      Eigen::MatrixXd jacobian(2, 18 + p);
      jacobian << -by_b, by_b * skew(bMc.linear() * point_c), by_e, -by_e * skew(eMo.linear() * point_o),
          by.parameters, by_e, -by_e * skew(eMo * point_o);
      view.noalias() += jacobian.transpose() * jacobian / (kCornerPx * kCornerPx);
    }
    const auto cross = view.topRightCorner(12 + p, 6);
    const Eigen::MatrixXd robot =
        view.bottomRightCorner(6, 6) + Eigen::MatrixXd(robot_sigma.cwiseAbs2().cwiseInverse().asDiagonal());
    information += view.topLeftCorner(12 + p, 12 + p) - cross * robot.ldlt().solve(cross.transpose());
  }
  return -information.topLeftCorner(12, 12).ldlt().solve(information.topRightCorner(12, p)).topRows(6);
}

}  // namespace servocal::procedure
