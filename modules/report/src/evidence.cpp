// SPDX-License-Identifier: GPL-3.0-or-later
#include "evidence.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <set>

#include "servocal/calib/board_pose.h"
#include "servocal/calib/reprojection.h"

namespace servocal::report {
namespace {

std::set<std::int64_t> usedIds(const std::vector<ViewResidual>& views) {
  std::set<std::int64_t> ids;
  for (const ViewResidual& view : views) {
    if (view.used) ids.insert(view.observation_id);
  }
  return ids;
}

const StreamObservation* viewOf(const Observation& observation, const std::string& camera, Stream stream) {
  for (const StreamObservation& view : observation.views) {
    if (view.camera == camera && view.stream == stream) return &view;
  }
  return nullptr;
}

/// The board pose that fits the corners best.
std::optional<Pose<Color, Board>> bestPose(const BoardSpec& board, const CameraModel& camera,
                                           const BoardDetection& detection) {
  const std::vector<calib::BoardPose> poses = calib::boardPoses(board, camera, detection);
  const auto best = std::min_element(poses.begin(), poses.end(),
                                     [](const auto& a, const auto& b) { return a.rms_px < b.rms_px; });
  if (best == poses.end()) return std::nullopt;
  return best->cMo;
}

}  // namespace

std::vector<CornerResidual> cornerResiduals(const ReportInput& input, const std::string& camera,
                                            Stream stream, const IntrinsicsResult& intrinsics) {
  const std::set<std::int64_t> used = usedIds(intrinsics.views);
  const std::vector<Eigen::Vector3d> corners_o = input.result.board.corners();
  std::vector<CornerResidual> residuals;
  for (const Observation& observation : input.observations) {
    const StreamObservation* view = viewOf(observation, camera, stream);
    if (view == nullptr || used.count(observation.id) == 0) continue;
    const auto cMo = bestPose(input.result.board, intrinsics.camera, view->detection);
    if (!cMo) continue;
    for (const Corner& corner : view->detection.corners) {
      const auto predicted = intrinsics.camera.project(*cMo * corners_o[static_cast<std::size_t>(corner.id)]);
      if (predicted) residuals.push_back({observation.id, corner.pixel, corner.pixel - *predicted});
    }
  }
  return residuals;
}

std::vector<PixelSigma> projectionSigma(const IntrinsicsResult& intrinsics, int across, int down) {
  const CameraModel& camera = intrinsics.camera;
  if (intrinsics.covariance.rows() != camera.parameters.size() || !intrinsics.covariance.allFinite())
    return {};
  std::vector<PixelSigma> map;
  std::vector<ProjectionJacobian> jacobians;
  std::vector<Eigen::Vector3d> rays;
  for (int row = 0; row < down; ++row) {
    for (int column = 0; column < across; ++column) {
      const Eigen::Vector2d pixel((camera.width_px - 1) * static_cast<double>(column) / (across - 1),
                                  (camera.height_px - 1) * static_cast<double>(row) / (down - 1));
      const auto ray = camera.unproject(pixel);
      ProjectionJacobian jacobian;
      if (!ray || !camera.project(ray->homogeneous(), jacobian)) continue;
      map.push_back({pixel, 0.0});
      jacobians.push_back(jacobian);
      rays.push_back(ray->homogeneous());
    }
  }
  if (map.empty()) return map;
  // Displacement of every grid point by the parameters, less what a turn of the camera explains of it.
  const auto points = static_cast<Eigen::Index>(map.size());
  Eigen::MatrixXd by_parameters(2 * points, camera.parameters.size());
  Eigen::MatrixXd by_turn(2 * points, 3);
  for (Eigen::Index i = 0; i < points; ++i) {
    const auto at = static_cast<std::size_t>(i);
    by_parameters.middleRows<2>(2 * i) = jacobians[at].parameters;
    for (int axis = 0; axis < 3; ++axis) {
      by_turn.block<2, 1>(2 * i, axis) = jacobians[at].point * Eigen::Vector3d::Unit(axis).cross(rays[at]);
    }
  }
  const Eigen::MatrixXd explained = by_turn * by_turn.householderQr().solve(by_parameters).eval();
  const Eigen::MatrixXd left = by_parameters - explained;
  for (Eigen::Index i = 0; i < points; ++i) {
    const Eigen::MatrixXd rows = left.middleRows<2>(2 * i);
    const double trace = (rows * intrinsics.covariance * rows.transpose()).trace();
    map[static_cast<std::size_t>(i)].sigma_px = std::sqrt(std::max(0.0, 0.5 * trace));
  }
  return map;
}

std::vector<HandEyeStep> handEyeSteps(const ReportInput& input, const CameraResult& camera) {
  if (!camera.hand_eye) return {};
  const std::set<std::int64_t> used = usedIds(camera.hand_eye->views);
  std::vector<Observation> seen;
  for (const Observation& observation : input.observations) {
    if (used.count(observation.id) == 0 || viewOf(observation, camera.camera, Stream::kColor) == nullptr)
      continue;
    seen.push_back(observation);
  }
  calib::ReprojectionOptions options;
  options.mount = camera.hand_eye->mount;
  options.robot_sigma_m = input.robot_accuracy_m;
  options.robot_sigma_rad = input.robot_accuracy_rad;
  options.start =
      camera.hand_eye;  // converges to the subset's own optimum all the same, several times faster
  std::vector<HandEyeStep> steps;
  for (std::size_t count = 4; count < seen.size(); count = std::max(count + 2, count * 5 / 4)) {
    const std::vector<Observation> first(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(count));
    const calib::HandEyeOutcome outcome = calib::solveHandEyeReprojection(
        input.result.board, camera.intrinsics.camera, first, camera.camera, Stream::kColor, options);
    if (!outcome.solution) continue;
    const Pose<Base, Color> part(outcome.solution->camera_pose), whole(camera.hand_eye->camera_pose);
    steps.push_back({static_cast<int>(count), distanceM(part, whole), angleRad(part, whole),
                     outcome.solution->camera_sigma.head<3>().norm()});
  }
  return steps;
}

std::vector<DepthSample> depthSamples(const ReportInput& input, const CameraResult& camera) {
  std::vector<DepthSample> samples;
  if (!camera.depth || !camera.infrared) return samples;
  const CameraModel& lens = camera.infrared->camera;
  for (const Observation& observation : input.observations) {
    const StreamObservation* view = viewOf(observation, camera.camera, Stream::kInfrared);
    if (view == nullptr || !view->depth) continue;
    const auto iMo = bestPose(input.result.board, lens, view->detection);
    if (!iMo) continue;
    const Eigen::Vector3d normal = iMo->rotation().col(2);
    for (const DepthPatch& patch : view->depth->patches) {
      const auto ray = lens.unproject(patch.pixel);
      const auto corrected_m = camera.depth->model.correct(patch.pixel, patch.depth_m);
      if (!ray || !corrected_m) continue;
      const double depth_m = normal.dot(iMo->translation()) / normal.dot(ray->homogeneous());
      samples.push_back({patch.pixel, depth_m, patch.depth_m - depth_m, *corrected_m - depth_m});
    }
  }
  return samples;
}

std::vector<VisitedPose> visitedPoses(const ReportInput& input, const CameraResult& camera) {
  std::vector<VisitedPose> poses;
  if (!camera.hand_eye) return poses;
  const bool fixed = camera.hand_eye->mount == Mount::kFixed;
  const Eigen::Isometry3d& carried = fixed ? camera.hand_eye->board_pose : camera.hand_eye->camera_pose;
  for (const Observation& observation : input.observations) {
    if (!observation.robot || !observation.robot->bMe.isFinite()) continue;
    poses.push_back({observation.stage, observation.robot->bMe.isometry() * carried});
  }
  return poses;
}

}  // namespace servocal::report
