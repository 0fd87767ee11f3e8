// SPDX-License-Identifier: GPL-3.0-or-later
#include "result_tree.h"

namespace servocal::session {

Json list(const Eigen::VectorXd& values) {
  return std::vector<double>(values.data(), values.data() + values.size());
}

Json matrix(const Eigen::MatrixXd& values) {
  Json rows = Json::array();
  for (Eigen::Index row = 0; row < values.rows(); ++row) rows.push_back(list(values.row(row).transpose()));
  return rows;
}

Json cameraModelTree(const CameraModel& camera, const Eigen::VectorXd& sigma) {
  const std::vector<std::string>& names = parameterNames(camera.lens);
  Json tree = {
      {"lens_model", toString(camera.lens)}, {"width_px", camera.width_px}, {"height_px", camera.height_px}};
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto index = static_cast<Eigen::Index>(i);
    Json entry = {{"value", camera.parameters[index]}};
    if (sigma.size() > 0) entry["sigma"] = sigma[index];
    tree["parameters"][withUnit(names[i])] = entry;
  }
  Eigen::Matrix3d k;
  k << camera.fx(), 0, camera.cx(), 0, camera.fy(), camera.cy(), 0, 0, 1;
  tree["camera_matrix_px"] = matrix(k);
  tree["distortion_coefficients"] = list(camera.parameters.tail(camera.parameters.size() - 4));
  return tree;
}

Json poseTree(const PoseNames& names, const Eigen::Isometry3d& pose,
              const Eigen::Matrix<double, 6, 1>& sigma) {
  const Eigen::Quaterniond q(pose.rotation());
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;  // of q and -q, the one with w >= 0
  return {{"name", names.name},
          {"parent_frame", names.parent},
          {"child_frame", names.child},
          {"translation_m", list(pose.translation())},
          {"translation_sigma_m", list(sigma.head<3>())},
          {"quaternion_xyzw", {sign * q.x(), sign * q.y(), sign * q.z(), sign * q.w()}},
          {"rotation_sigma_deg", list(sigma.tail<3>() * kDegPerRad)},
          {"matrix", matrix(pose.matrix())}};
}

}  // namespace servocal::session
