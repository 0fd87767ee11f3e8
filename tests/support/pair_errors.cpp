// SPDX-License-Identifier: GPL-3.0-or-later
#include "pair_errors.h"

#include <cmath>

#include "servocal/core/best_estimate.h"

namespace servocal::test {
namespace {

using CameraPose = Pose<Base, Color>;

struct Placed {
  CameraPose found, truth;
};

PairError errorOf(const Placed& first, const Placed& second, const Eigen::Vector3d& middle) {
  constexpr int kPoints = 27;
  constexpr double kHalfM = 0.15;
  PairError error;
  for (int i = 0; i < kPoints; ++i) {
    const Eigen::Vector3d point = middle + kHalfM * Eigen::Vector3d(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
    const Eigen::Vector3d by_first = first.found * (first.truth.inverse() * point);
    const Eigen::Vector3d by_second = second.found * (second.truth.inverse() * point);
    error.first_m += (by_first - point).squaredNorm() / kPoints;
    error.second_m += (by_second - point).squaredNorm() / kPoints;
    error.between_m += (by_first - by_second).squaredNorm() / kPoints;
  }
  for (double* sum : {&error.first_m, &error.second_m, &error.between_m}) *sum = std::sqrt(*sum);
  const auto found = first.found.inverse() * second.found, truth = first.truth.inverse() * second.truth;
  error.pose_m = distanceM(found, truth);
  error.pose_rad = angleRad(found, truth);
  return error;
}

std::optional<CameraPose> jointPose(const CalibrationResult& result, const std::string& camera) {
  if (!result.joint) return std::nullopt;
  const JointCameraResult* joint = result.joint->find(camera, Stream::kColor);
  return joint == nullptr ? std::nullopt : std::optional(CameraPose(joint->pose));
}

bool hasTimeOfFlight(const CameraResult& camera) {
  return camera.color_infrared && camera.depth && camera.depth->model.sensor == DepthSensor::kTimeOfFlight;
}

}  // namespace

std::vector<CameraPairErrors> pairErrors(const sim::Truth& truth, const CalibrationResult& result,
                                         const std::vector<PlaneShot>& shots,
                                         const Eigen::Vector3d& board_at_start) {
  std::vector<CameraPairErrors> pairs;
  const CalibrationResult best = bestEstimate(result);
  const auto stands = [](const CameraResult& camera) {
    return camera.hand_eye && camera.hand_eye->mount == Mount::kFixed;
  };
  for (std::size_t i = 0; i < result.cameras.size(); ++i) {
    for (std::size_t k = i + 1; k < result.cameras.size(); ++k) {
      const CameraResult &a = result.cameras[i], &b = result.cameras[k];
      if (!stands(a) || !stands(b)) continue;
      CameraPairErrors pair;
      pair.first = a.camera;
      pair.second = b.camera;
      const CameraPose true_a = truth.bMc(a.camera), true_b = truth.bMc(b.camera);
      pair.staged = errorOf({CameraPose(a.hand_eye->camera_pose), true_a},
                            {CameraPose(b.hand_eye->camera_pose), true_b}, board_at_start);
      const auto joint_a = jointPose(result, a.camera), joint_b = jointPose(result, b.camera);
      if (joint_a && joint_b) pair.joint = errorOf({*joint_a, true_a}, {*joint_b, true_b}, board_at_start);
      if (!shots.empty() && hasTimeOfFlight(a) && hasTimeOfFlight(b)) {
        pair.raw = planeGaps(result, shots, a.camera, b.camera, Cloud::kRaw);
        pair.corrected = planeGaps(result, shots, a.camera, b.camera, Cloud::kCorrected);
        pair.best = planeGaps(best, shots, a.camera, b.camera, Cloud::kCorrected);
      }
      pairs.push_back(std::move(pair));
    }
  }
  return pairs;
}

}  // namespace servocal::test
