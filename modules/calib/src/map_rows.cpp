// SPDX-License-Identifier: GPL-3.0-or-later
#include "map_rows.h"

#include <algorithm>

#include "se3.h"

namespace servocal::calib {

std::optional<Seen> seenAt(const JointCamera& camera, const Eigen::Vector3d& point_c) {
  Seen out;
  out.point_c = point_c;
  if (!camera.model.project(point_c, out.by)) return std::nullopt;
  return out;
}

Eigen::MatrixXd byIntrinsics(const JointCamera& camera, const ProjectionJacobian& by) {
  Eigen::MatrixXd out(2, static_cast<Eigen::Index>(camera.free.size()));
  for (std::size_t p = 0; p < camera.free.size(); ++p) {
    out.col(static_cast<Eigen::Index>(p)) = by.parameters.col(camera.free[p]);
  }
  return out;
}

Eigen::Matrix<double, 2, 6> byPose(const JointCamera& camera, const Seen& seen, bool at_infinity) {
  const Eigen::Matrix<double, 2, 3> by_l = seen.by.point * camera.pose.linear().transpose();
  Eigen::Matrix<double, 2, 6> out;
  out << -by_l, by_l * skew(camera.pose.linear() * seen.point_c);
  if (at_infinity) out.leftCols<3>().setZero();
  return out;
}

std::vector<std::optional<Seen>> grid(const JointCamera& camera, int cells_x, int cells_y, double depth_m) {
  std::vector<std::optional<Seen>> out;
  for (int y = 0; y < cells_y; ++y) {
    for (int x = 0; x < cells_x; ++x) {
      const Eigen::Vector2d pixel(x * (camera.model.width_px - 1.0) / std::max(1, cells_x - 1),
                                  y * (camera.model.height_px - 1.0) / std::max(1, cells_y - 1));
      const auto ray = camera.model.unproject(pixel);
      out.push_back(ray ? seenAt(camera, depth_m * Eigen::Vector3d(ray->x(), ray->y(), 1.0)) : std::nullopt);
    }
  }
  return out;
}

std::optional<Eigen::MatrixXd> byBackProjection(const JointCamera& camera, const Eigen::Vector3d& point_l) {
  const Eigen::Vector3d point_c = camera.pose.inverse() * point_l;
  const auto seen = seenAt(camera, point_c);
  if (!seen) return std::nullopt;
  const auto pixel = camera.model.project(point_c);
  if (!pixel || !camera.model.contains(*pixel)) return std::nullopt;
  const Eigen::Matrix2d by_plane = seen->by.point.leftCols<2>();  // by X, Y at this depth
  Eigen::MatrixXd by_c = Eigen::MatrixXd::Zero(3, static_cast<Eigen::Index>(camera.free.size()));
  by_c.topRows<2>() = -by_plane.inverse() * byIntrinsics(camera, seen->by);
  Eigen::MatrixXd out(3, by_c.cols() + 6);
  out << camera.pose.linear() * by_c, Eigen::Matrix3d::Identity(), -skew(camera.pose.linear() * point_c);
  return out;
}

}  // namespace servocal::calib
