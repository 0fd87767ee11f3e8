// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/procedure/solve.h"

#include <algorithm>
#include <set>
#include <string>

#include "servocal/calib/reprojection.h"

namespace servocal::procedure {

CalibrationResult solve(const BoardSpec& board, const std::vector<Observation>& observations,
                        const SolveOptions& options) {
  CalibrationResult result;
  result.board = board;
  result.observations = static_cast<int>(observations.size());
  std::set<std::string> cameras;
  for (const Observation& observation : observations) {
    for (const StreamObservation& view : observation.views) cameras.insert(view.camera);
  }
  const bool has_robot = std::any_of(observations.begin(), observations.end(),
                                     [](const Observation& observation) { return observation.robot.has_value(); });
  if (cameras.empty()) result.missing.push_back("no view of the board");

  for (const std::string& camera : cameras) {
    const calib::IntrinsicsOutcome intrinsics =
        calib::solveIntrinsics(board, observations, camera, Stream::kColor, options.intrinsics);
    if (!intrinsics.result) {
      result.missing.push_back("intrinsics of " + camera + ": " + calib::toString(intrinsics.status));
      continue;
    }
    CameraResult camera_result;
    camera_result.camera = camera;
    camera_result.intrinsics = *intrinsics.result;
    if (has_robot) {
      calib::ReprojectionOptions reprojection;
      reprojection.mount = options.mount;
      reprojection.robot_sigma_m = options.robot_sigma_m;
      reprojection.robot_sigma_rad = options.robot_sigma_rad;
      const calib::HandEyeOutcome hand_eye = calib::solveHandEyeReprojection(
          board, intrinsics.result->camera, observations, camera, Stream::kColor, reprojection);
      if (hand_eye.solution) {
        camera_result.hand_eye = hand_eye.solution;
      } else {
        result.missing.push_back("hand-eye of " + camera + ": " + calib::toString(hand_eye.status));
      }
    }
    result.cameras.push_back(std::move(camera_result));
  }
  result.goal_met = result.missing.empty();
  return result;
}

}  // namespace servocal::procedure
