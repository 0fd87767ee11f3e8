// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/best_estimate.h"

#include <algorithm>

namespace servocal {
namespace {

IntrinsicsResult lensOf(const JointCameraResult& stream) {
  IntrinsicsResult lens;
  lens.camera = stream.model;
  lens.sigma = stream.sigma;
  lens.rms_px = stream.rms_px;
  return lens;
}

HandEyeSolution handEyeOf(const JointResult& joint, const JointCameraResult& stream) {
  HandEyeSolution solution;
  solution.mount = joint.mount;
  solution.camera_pose = stream.pose;
  solution.camera_sigma = stream.pose_covariance.diagonal().cwiseSqrt();
  solution.board_pose = joint.board_pose;
  solution.board_sigma = joint.board_sigma;
  solution.rms_px = stream.rms_px;
  return solution;
}

CameraPair pairOf(const JointPair& beside) {
  CameraPair pair;
  pair.first = beside.first;
  pair.second = beside.second;
  pair.first_by_second = beside.first_by_second;
  pair.covariance = beside.covariance;
  return pair;
}

void takeInfrared(const JointResult& joint, CameraResult& camera) {
  const JointCameraResult* infrared = joint.find(camera.camera, Stream::kInfrared);
  if (infrared == nullptr) return;
  camera.infrared = lensOf(*infrared);
  camera.infrared_hand_eye = handEyeOf(joint, *infrared);
  if (camera.depth) camera.depth->model.camera = infrared->model;
  for (const JointPair& pair : joint.pairs) {
    if (pair.first == camera.camera && pair.second == camera.camera) camera.color_infrared = pairOf(pair);
  }
}

}  // namespace

CalibrationResult bestEstimate(const CalibrationResult& result) {
  CalibrationResult best = result;
  if (!result.joint) return best;
  const JointResult& joint = *result.joint;
  for (CameraResult& camera : best.cameras) {
    const JointCameraResult* color = joint.find(camera.camera, Stream::kColor);
    if (color == nullptr) continue;  // Infrared alone would not fit the color camera's pose.
    camera.intrinsics = lensOf(*color);
    camera.hand_eye = handEyeOf(joint, *color);
    camera.intrinsics_with_outliers.reset();
    camera.hand_eye_with_outliers.reset();
    takeInfrared(joint, camera);
  }
  for (CameraPair& pair : best.camera_pairs) {
    const auto beside = std::find_if(joint.pairs.begin(), joint.pairs.end(), [&](const JointPair& candidate) {
      return candidate.first == pair.first && candidate.second == pair.second;
    });
    if (beside != joint.pairs.end()) pair = pairOf(*beside);
  }
  return best;
}

const JointCameraResult* JointResult::find(const std::string& camera, Stream stream) const {
  const auto found = std::find_if(cameras.begin(), cameras.end(), [&](const JointCameraResult& candidate) {
    return candidate.camera == camera && candidate.stream == stream;
  });
  return found == cameras.end() ? nullptr : &*found;
}

}  // namespace servocal
