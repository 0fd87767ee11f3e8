// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_errors.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "joint_arm.h"
#include "servocal/calib/uncertainty.h"
#include "servocal/procedure/solve.h"
#include "sim_truth.h"

namespace servocal::test {
namespace {

CameraModel trueModel(const sim::Truth& truth, const JointCameraResult& camera) {
  return camera.stream == Stream::kColor ? truth.camera(camera.camera) : truth.infrared(camera.camera);
}

Eigen::Isometry3d truePose(const sim::Truth& truth, const JointCameraResult& camera) {
  const Pose<Base, Color> bMc = truth.bMc(camera.camera);
  if (camera.stream == Stream::kColor) return bMc.isometry();
  return (bMc * truth.cMi(camera.camera)).isometry();
}

/// The truth as a solution with the parameters that the estimate has, and the covariance of the bound.
calib::JointSolution boundOf(const CellConfig& cell, const sim::Truth& truth, const CalibrationResult& result,
                             const std::vector<Observation>& observations) {
  const JointResult& joint = *result.joint;
  calib::JointSolution at;
  int next = 0;
  for (const JointCameraResult& estimate : joint.cameras) {
    calib::JointCamera camera;
    camera.camera = estimate.camera;
    camera.stream = estimate.stream;
    camera.model = trueModel(truth, estimate);
    camera.pose = truePose(truth, estimate);
    camera.corner_scale = estimate.corner_scale;
    for (Eigen::Index p = 0; p < estimate.sigma.size(); ++p) {
      if (estimate.sigma[p] != 0) camera.free.push_back(static_cast<int>(p));
    }
    camera.intrinsics_at = next;
    camera.pose_at = next + static_cast<int>(camera.free.size());
    next = camera.pose_at + 6;
    at.cameras.push_back(camera);
  }
  at.board_pose = truth.eMo().isometry();
  at.board_freedom.bow = joint.board_bow_x_m != 0 || joint.board_bow_y_m != 0;
  at.robot.sigma_m = joint.robot_sigma_m;
  at.robot.sigma_rad = joint.robot_sigma_rad;
  if (!joint.robot_terms.empty()) at.robot_model = procedure::armTerms(cell.arm, observations);
  at.robot_terms = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(joint.robot_terms.size()));
  std::vector<Observation> taken;
  std::copy_if(observations.begin(), observations.end(), std::back_inserter(taken),
               [](const Observation& observation) { return observation.stage != procedure::kCheckStage; });
  try {
    at.covariance = calib::jointCovarianceAt(result.board, taken, at);
  } catch (const std::invalid_argument&) {
    at.covariance = Eigen::MatrixXd::Constant(next + 6, next + 6, NAN);
  }
  return at;
}

/// Worst over the image: what the truth sees there at this distance, projected by the estimate.
double worstErrorPx(const JointCameraResult& estimate, const calib::JointCamera& truth) {
  constexpr int kCellsX = 13, kCellsY = 9;
  double worst_px = 0;
  const Eigen::Isometry3d estimated_by_true = estimate.pose.inverse() * truth.pose;
  for (int i = 0; i < kCellsX * kCellsY; ++i) {
    const Eigen::Vector2d pixel((i % kCellsX) * (truth.model.width_px - 1.0) / (kCellsX - 1),
                                (i / kCellsX) * (truth.model.height_px - 1.0) / (kCellsY - 1));
    const auto ray = truth.model.unproject(pixel);
    if (!ray) continue;
    const Eigen::Vector3d point = estimate.range_m * Eigen::Vector3d(ray->x(), ray->y(), 1.0);
    const auto seen = estimate.model.project(estimated_by_true * point);
    worst_px = std::max(worst_px, seen ? (*seen - pixel).norm() : INFINITY);
  }
  return worst_px;
}

}  // namespace

std::vector<JointErrors> jointErrors(const CellConfig& cell, const sim::Truth& truth,
                                     const CalibrationResult& result,
                                     const std::vector<Observation>& observations) {
  std::vector<JointErrors> out;
  if (!result.joint) return out;
  const calib::JointSolution bound = boundOf(cell, truth, result, observations);
  for (std::size_t k = 0; k < result.joint->cameras.size(); ++k) {
    const JointCameraResult& estimate = result.joint->cameras[k];
    const calib::JointCamera& known = bound.cameras[k];
    JointErrors errors;
    errors.camera = estimate.camera;
    errors.stream = estimate.stream;
    Eigen::Matrix<double, 6, 1> off;
    off << estimate.pose.translation() - known.pose.translation(),
        Pose<Base, Base>(Eigen::Matrix3d(estimate.pose.linear() * known.pose.linear().transpose()), {0, 0, 0})
            .rotationVector();
    errors.pose_m = off.head<3>().norm();
    errors.pose_rad = off.tail<3>().norm();
    errors.pose_z = std::sqrt(off.dot(estimate.pose_covariance.ldlt().solve(off)) / 6);
    errors.error_px = worstErrorPx(estimate, known);
    errors.claim_px = estimate.at_range.worst_px;
    errors.bound_px = calib::projectionMap(bound, known, calib::Anchor::kBase, estimate.range_m).worst_px;
    errors.pose_bound_m = std::sqrt(bound.covariance.block<3, 3>(known.pose_at, known.pose_at).trace());
    out.push_back(errors);
  }
  return out;
}

}  // namespace servocal::test
