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

/// How the base that the arm's reports are in, corrected by what the estimate found of its geometry, lies in
/// the true one: together with a pose of what the flange holds, as free as it, the least squares of those
/// against the true flange poses at the stops. To first order.
Eigen::Isometry3d reportedBase(const CellConfig& cell, const sim::Truth& truth, const JointResult& joint,
                               const std::vector<Observation>& observations) {
  constexpr double kLeverM = 0.3;  // Weighs rotations: the board's and the cameras' distance from the flange.
  const auto terms = joint.robot_terms.empty() ? std::nullopt : procedure::armTerms(cell.arm, observations);
  Eigen::VectorXd found(static_cast<Eigen::Index>(joint.robot_terms.size()));
  for (Eigen::Index i = 0; i < found.size(); ++i) found[i] = joint.robot_terms[i].second;
  std::vector<const RobotState*> stops;
  for (const Observation& observation : observations) {
    if (observation.robot) stops.push_back(&*observation.robot);
  }
  const auto rows = static_cast<Eigen::Index>(6 * stops.size());
  Eigen::MatrixXd by_poses =
      Eigen::MatrixXd::Zero(rows, 12);  // base: displacement, turn; flange: the same, in e
  Eigen::VectorXd off(rows);
  for (std::size_t i = 0; i < stops.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(6 * i);
    Pose<Base, EndEffector> reported = stops[i]->bMe;
    if (terms) {
      const Eigen::Matrix<double, 6, 1> moved = terms->jacobian(*stops[i]) * found;
      reported =
          reported * Pose<EndEffector, EndEffector>::fromRotationVector(moved.tail<3>(), moved.head<3>());
    }
    const Pose<Base, EndEffector> real = truth.bMe(stops[i]->q);
    const Eigen::Matrix3d bRe = reported.rotation();
    off.segment<3>(row) = real.translation() - reported.translation();
    off.segment<3>(row + 3) =
        kLeverM *
        Pose<Base, Base>(Eigen::Matrix3d(real.rotation() * bRe.transpose()), {0, 0, 0}).rotationVector();
    by_poses.block<3, 3>(row, 0).setIdentity();
    for (int axis = 0; axis < 3; ++axis)
      by_poses.block<3, 1>(row, 3 + axis) = Eigen::Vector3d::Unit(axis).cross(reported.translation());
    by_poses.block<3, 3>(row + 3, 3) = kLeverM * Eigen::Matrix3d::Identity();
    by_poses.block<3, 3>(row, 6) = bRe;
    by_poses.block<3, 3>(row + 3, 9) = kLeverM * bRe;
  }
  const Eigen::VectorXd best = by_poses.completeOrthogonalDecomposition().solve(off);
  return Pose<Base, Base>::fromRotationVector(best.segment<3>(3), best.head<3>()).isometry();
}

/// Displacement and rotation vector of an estimate against the truth, in the base.
Eigen::Matrix<double, 6, 1> offBy(const Eigen::Isometry3d& estimate, const Eigen::Isometry3d& truth) {
  Eigen::Matrix<double, 6, 1> off;
  off << estimate.translation() - truth.translation(),
      Pose<Base, Base>(Eigen::Matrix3d(estimate.linear() * truth.linear().transpose()), {0, 0, 0})
          .rotationVector();
  return off;
}

PoseError errorOf(const Eigen::Isometry3d& estimate, const Eigen::Isometry3d& truth,
                  const Eigen::Matrix<double, 6, 6>& covariance) {
  const Eigen::Matrix<double, 6, 1> off = offBy(estimate, truth);
  const Eigen::Vector3d moved = off.head<3>(), turned = off.tail<3>();
  return {moved.norm(), turned.norm(), moved.dot(covariance.topLeftCorner<3, 3>().ldlt().solve(moved)),
          turned.dot(covariance.bottomRightCorner<3, 3>().ldlt().solve(turned)),
          off.dot(covariance.ldlt().solve(off))};
}

/// The truth as a solution with the parameters that the estimate has, and the covariance of the bound.
calib::JointSolution boundOf(const CellConfig& cell, const sim::Truth& truth, const JointResult& joint,
                             const std::vector<Observation>& observations) {
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
    at.covariance = calib::jointCovarianceAt(cell.board, taken, at);
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

double PoseError::z() const { return std::sqrt(whole / 6); }

std::vector<JointErrors> jointErrors(const CellConfig& cell, const sim::Truth& truth,
                                     const JointResult& joint, const std::vector<Observation>& observations) {
  std::vector<JointErrors> out;
  const calib::JointSolution bound = boundOf(cell, truth, joint, observations);
  const Eigen::Isometry3d base = reportedBase(cell, truth, joint, observations);
  for (std::size_t k = 0; k < joint.cameras.size(); ++k) {
    const JointCameraResult& estimate = joint.cameras[k];
    const calib::JointCamera& known = bound.cameras[k];
    JointErrors errors;
    errors.camera = estimate.camera;
    errors.stream = estimate.stream;
    errors.pose = errorOf(estimate.pose, known.pose, estimate.pose_covariance);
    errors.reported = errorOf(estimate.pose, base.inverse() * known.pose, estimate.pose_covariance);
    for (Eigen::Index p = 0; p < estimate.sigma.size(); ++p) {
      if (!(estimate.sigma[p] > 0)) continue;  // held, or left open
      errors.lens +=
          std::pow((estimate.model.parameters[p] - known.model.parameters[p]) / estimate.sigma[p], 2);
      ++errors.lens_size;
    }
    errors.error_px = worstErrorPx(estimate, known);
    errors.claim_px = estimate.at_range.worst_px;
    errors.bound_px = calib::projectionMap(bound, known, calib::Anchor::kBase, estimate.range_m).worst_px;
    errors.pose_bound_m = std::sqrt(bound.covariance.block<3, 3>(known.pose_at, known.pose_at).trace());
    out.push_back(errors);
  }
  return out;
}

}  // namespace servocal::test
