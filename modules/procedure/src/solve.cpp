// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/procedure/solve.h"

#include <algorithm>
#include <set>
#include <string>

#include "servocal/calib/reprojection.h"

namespace servocal::procedure {

namespace {

/// Images in which nobody saw the board, so that the result accounts for every one of them.
void listUnseen(const std::vector<Observation>& observations, std::vector<ViewResidual>& views) {
  for (const Observation& observation : observations) {
    if (!observation.views.empty()) continue;
    views.push_back({observation.id, observation.stage, 0.0, false,
                     observation.robot ? "no board found; its robot pose is left out too" : "no board found"});
  }
  std::stable_sort(views.begin(), views.end(), [](const ViewResidual& a, const ViewResidual& b) {
    return a.observation_id < b.observation_id;
  });
}

std::optional<IntrinsicsResult> solveIntrinsics(const BoardSpec& board, const std::vector<Observation>& observations,
                                                const std::string& camera, const SolveOptions& options,
                                                std::vector<std::string>& missing) {
  if (options.given_intrinsics) {
    IntrinsicsResult given;  // No standard deviations: nothing was estimated.
    given.camera = *options.given_intrinsics;
    return given;
  }
  calib::IntrinsicsOutcome outcome =
      calib::solveIntrinsics(board, observations, camera, Stream::kColor, options.intrinsics);
  if (!outcome.result) {
    missing.push_back("intrinsics of " + camera + ": " + calib::toString(outcome.status));
  } else {
    listUnseen(observations, outcome.result->views);
  }
  return outcome.result;
}

std::optional<HandEyeSolution> solveHandEye(const BoardSpec& board, const CameraModel& model,
                                            const std::vector<Observation>& observations, const std::string& camera,
                                            const SolveOptions& options, std::vector<std::string>& missing) {
  calib::ReprojectionOptions reprojection;
  reprojection.mount = options.mount;
  reprojection.robot_sigma_m = options.robot_sigma_m;
  reprojection.robot_sigma_rad = options.robot_sigma_rad;
  calib::HandEyeOutcome outcome =
      calib::solveHandEyeReprojection(board, model, observations, camera, Stream::kColor, reprojection);
  if (!outcome.solution) {
    missing.push_back("hand-eye of " + camera + ": " + calib::toString(outcome.status));
  } else {
    listUnseen(observations, outcome.solution->views);
  }
  return outcome.solution;
}

}  // namespace

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
  if (cameras.empty()) {
    result.missing.push_back("the board was found in none of " + std::to_string(observations.size()) +
                             " images; check the board's description: it reads " + board.describe());
  }
  for (const std::string& camera : cameras) {
    const auto intrinsics = solveIntrinsics(board, observations, camera, options, result.missing);
    if (!intrinsics) continue;
    CameraResult camera_result;
    camera_result.camera = camera;
    camera_result.intrinsics = *intrinsics;
    if (has_robot) {
      camera_result.hand_eye =
          solveHandEye(board, intrinsics->camera, observations, camera, options, result.missing);
    } else if (options.given_intrinsics) {
      result.missing.push_back(camera + ": intrinsics are given and there are no robot poses; nothing to solve");
    }
    result.cameras.push_back(std::move(camera_result));
  }
  result.goal_met = result.missing.empty();
  return result;
}

}  // namespace servocal::procedure
