// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/procedure/solve.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <string>

#include "joint.h"
#include "servocal/calib/board_pose.h"
#include "servocal/calib/camera_pair.h"
#include "servocal/calib/depth_distortion.h"
#include "servocal/calib/diagnose.h"
#include "servocal/calib/eye_to_hand.h"
#include "servocal/core/error.h"
#include "servocal/core/mount.h"
#include "stream_solver.h"

namespace servocal::procedure {
namespace {

bool has(const Observation& observation, const std::string& camera, Stream stream) {
  return std::any_of(observation.views.begin(), observation.views.end(), [&](const StreamObservation& view) {
    return view.camera == camera && view.stream == stream;
  });
}

/// Adds what there is of a camera's infrared side to its result.
void solveInfrared(const BoardSpec& board, const std::vector<Observation>& observations, bool has_robot,
                   const SolveOptions& options, CameraResult& result, std::vector<std::string>& missing) {
  StreamSolver solver(board, observations, result.camera, Stream::kInfrared, options);
  auto solved = solver.solve(has_robot);
  missing.insert(missing.end(), solver.missing().begin(), solver.missing().end());
  if (!solved) return;
  for (const std::string& note : solved->notes) result.notes.push_back("infrared: " + note);
  result.infrared = std::move(solved->intrinsics);
  result.infrared_hand_eye = std::move(solved->hand_eye);
  result.combined_views = static_cast<int>(
      std::count_if(observations.begin(), observations.end(), [&](const Observation& observation) {
        return has(observation, result.camera, Stream::kColor) && has(observation, result.camera, Stream::kInfrared);
      }));
  const calib::PairCamera color{result.camera, Stream::kColor, result.intrinsics.camera};
  const calib::PairCamera infrared{result.camera, Stream::kInfrared, result.infrared->camera};
  calib::PairOutcome pair = calib::solveCameraPair(board, color, infrared, observations);
  if (pair.solution) {
    result.color_infrared = *std::move(pair.solution);
  } else if (pair.status == calib::PairStatus::kNoCommonView && result.hand_eye && result.infrared_hand_eye) {
    result.color_infrared = calib::pairByRobot(color, *result.hand_eye, infrared, *result.infrared_hand_eye);
    result.notes.push_back("color and infrared never saw the board at once: their pose is by the robot");
  } else {
    missing.push_back("pose of infrared in color of " + result.camera + ": " + calib::toString(pair.status));
  }
}

/// Where robot and hand-eye say the board was, if there is no joint estimate.
std::map<std::int64_t, Pose<Infrared, Board>> boardPosesByRobot(const std::vector<Observation>& observations,
                                                                const std::optional<HandEyeSolution>& hand_eye) {
  std::map<std::int64_t, Pose<Infrared, Board>> poses;
  if (!hand_eye) return poses;
  const Pose<Base, Infrared> bMi(hand_eye->camera_pose);
  const Pose<EndEffector, Board> eMo(hand_eye->board_pose);
  for (const Observation& observation : observations) {
    if (observation.robot) {
      poses.emplace(observation.id, bMi.inverse() * forMount(hand_eye->mount, observation.robot->bMe) * eMo);
    }
  }
  return poses;
}

/// A sentence if depth and images cannot both be right about the size of the board, and the robot's motion does not say
/// which is: the depth correction would take a wrong size for an error of the sensor.
std::optional<std::string> findWrongSize(const BoardSpec& board, const std::vector<Observation>& observations,
                                         CameraResult& result) {
  constexpr double kMostSensorError = 0.08;  // Uncorrected depth of both kinds of sensor stays below 0.06.
  constexpr double kSigmas = 5.0;
  auto scale = calib::boardScaleByDepth(board, result.infrared->camera, observations, result.camera);
  if (!scale) return std::nullopt;
  if (result.infrared->sigma.size() > 0) {
    scale->sigma = std::hypot(scale->sigma, result.infrared->sigma[0] / result.infrared->camera.fx());
  }
  const double off = std::abs(scale->scale - 1.0);
  if (off < std::max(kMostSensorError, kSigmas * scale->sigma)) return std::nullopt;
  const std::string sizes = calib::sizeText(board, scale->scale, "the depth");
  if (result.board_scale && std::abs(result.board_scale->scale - 1.0) < 0.5 * off) {
    result.notes.push_back(sizes + ", but the robot's motion agrees with the latter: the depth is off in that ratio; "
                                   "check its unit");
    return std::nullopt;
  }
  return "depth and infrared images contradict each other; they agree if " + sizes +
         " (or if the depth is off in that ratio)";
}

/// The board's places by the joint estimate, and the camera they are places in; false if there is none, or it leaves the
/// places open.
bool takeJointly(const JointAnswer& joint, const std::string& camera, CameraModel& infrared,
                 calib::DepthOptions& options) {
  const auto places = joint.infrared_boards.find(camera);
  if (places == joint.infrared_boards.end() || !std::isfinite(places->second.common_m)) return false;
  for (const auto& [id, iMo] : places->second.poses) options.board_poses.emplace(id, Pose<Infrared, Board>(iMo));
  options.board_pose_sigma_m = places->second.sigma_m;
  options.board_pose_sigma_rad = places->second.sigma_rad;
  options.board_pose_common_m = places->second.common_m;
  for (const JointCameraResult& solved : joint.result->cameras) {
    if (solved.camera == camera && solved.stream == Stream::kInfrared) infrared = solved.model;
  }
  return true;
}

void solveDepth(const BoardSpec& board, const std::vector<Observation>& observations, const SolveOptions& options,
                const JointAnswer& joint, CameraResult& result, std::vector<std::string>& missing) {
  const auto sensor = options.depth_sensors.find(result.camera);
  if (sensor == options.depth_sensors.end() || !result.infrared) return;
  if (const auto contradiction = findWrongSize(board, observations, result)) {
    const std::string sentence = "depth of " + result.camera + ": " + *contradiction;
    if (options.refuse_contradictions) throw Error(ErrorKind::kBadData, sentence);
    missing.push_back(sentence);
    return;
  }
  calib::DepthOptions depth_options;
  CameraModel infrared = result.infrared->camera;
  if (!takeJointly(joint, result.camera, infrared, depth_options)) {
    depth_options.board_poses = boardPosesByRobot(observations, result.infrared_hand_eye);
    depth_options.board_pose_sigma_m = options.robot_sigma_m;
    depth_options.board_pose_sigma_rad = options.robot_sigma_rad;
  }
  auto outcome = calib::solveDepth(board, infrared, observations, result.camera, sensor->second, depth_options);
  if (outcome.result) {
    result.depth = *std::move(outcome.result);
    // Registering depth to color takes lens and pose from one estimate, that in stages. The correction hardly asks.
    result.depth->model.camera = result.infrared->camera;
  } else {
    missing.push_back("depth of " + result.camera + ": " + outcome.reason);
  }
}

/// The paper's estimator on the same stops, to be reported beside ours.
void addAffineBaseline(const BoardSpec& board, const std::vector<Observation>& observations, CameraResult& result) {
  if (!result.depth || !result.infrared_hand_eye || result.infrared_hand_eye->mount != Mount::kFixed) return;
  const Pose<EndEffector, Board> eMo(result.infrared_hand_eye->board_pose);
  result.affine_baseline =
      calib::solveAffineEyeToHand(
          calib::boardPoints(board, result.depth->model, observations, result.camera, eMo))
          .result;
}

/// Errors in views that no solver saw: what the robot and the result predict against what is seen.
std::optional<HeldOut> holdOut(const BoardSpec& board, const std::vector<Observation>& kept, const CameraResult& camera) {
  if (!camera.hand_eye) return std::nullopt;
  const Pose<Base, Color> bMc(camera.hand_eye->camera_pose);
  const Pose<EndEffector, Board> eMo(camera.hand_eye->board_pose);
  HeldOut held_out;
  double squares_px2 = 0.0, squares_m2 = 0.0;
  int corners = 0;
  for (const Observation& observation : kept) {
    for (const StreamObservation& view : observation.views) {
      if (view.camera != camera.camera || view.stream != Stream::kColor || !observation.robot) continue;
      const Pose<Color, Board> predicted =
          bMc.inverse() * forMount(camera.hand_eye->mount, observation.robot->bMe) * eMo;
      const auto seen = calib::refineBoardPose(board, camera.intrinsics.camera, view.detection, predicted);
      if (!seen) continue;
      ++held_out.views;
      for (const Corner& corner : view.detection.corners) {
        const Eigen::Vector3d point = board.corner(corner.id);
        const auto pixel = camera.intrinsics.camera.project(predicted * point);
        if (!pixel) continue;
        squares_px2 += (*pixel - corner.pixel).squaredNorm();
        squares_m2 += (predicted * point - seen->cMo * point).squaredNorm();
        ++corners;
      }
    }
  }
  if (corners == 0) return std::nullopt;
  held_out.rms_px = std::sqrt(squares_px2 / corners);
  held_out.rms_m = std::sqrt(squares_m2 / corners);
  return held_out;
}

}  // namespace

GivenIntrinsics intrinsicsOf(const CalibrationResult& result) {
  GivenIntrinsics given;
  for (const CameraResult& camera : result.cameras) {
    given.emplace(std::pair(camera.camera, Stream::kColor), camera.intrinsics.camera);
    if (camera.infrared) given.emplace(std::pair(camera.camera, Stream::kInfrared), camera.infrared->camera);
  }
  return given;
}

std::map<std::string, DepthSensor> depthSensors(const CellConfig& cell) {
  std::map<std::string, DepthSensor> sensors;
  for (const CameraConfig& camera : cell.cameras) {
    if (camera.infrared && camera.infrared->depth) sensors.emplace(camera.name, *camera.infrared->depth);
  }
  return sensors;
}

CalibrationResult solve(const BoardSpec& board, const std::vector<Observation>& all_observations,
                        const SolveOptions& options) {
  std::vector<Observation> observations, kept;
  for (const Observation& observation : all_observations) {
    (observation.stage == kCheckStage ? kept : observations).push_back(observation);
  }
  CalibrationResult result;
  result.board = board;
  result.observations = static_cast<int>(all_observations.size());
  std::set<std::string> cameras, with_infrared;
  for (const Observation& observation : observations) {
    for (const StreamObservation& view : observation.views) {
      cameras.insert(view.camera);
      if (view.stream == Stream::kInfrared) with_infrared.insert(view.camera);
    }
  }
  const bool has_robot = std::any_of(observations.begin(), observations.end(),
                                     [](const Observation& observation) { return observation.robot.has_value(); });
  if (cameras.empty()) {
    result.missing.push_back("the board was found in none of " + std::to_string(observations.size()) +
                             " images; check the board's description: it reads " + board.describe());
  }
  for (const std::string& camera : cameras) {
    StreamSolver solver(board, observations, camera, Stream::kColor, options);
    auto solved = solver.solve(has_robot);
    result.missing.insert(result.missing.end(), solver.missing().begin(), solver.missing().end());
    if (!solved) continue;
    if (!has_robot && cameras.size() == 1 && options.given_intrinsics.count({camera, Stream::kColor}) > 0) {
      result.missing.push_back(camera + ": intrinsics are given and there are no robot poses; nothing to solve");
    }
    if (with_infrared.count(camera) > 0) {
      solveInfrared(board, observations, has_robot, options, *solved, result.missing);
    }
    solved->held_out = holdOut(board, kept, *solved);
    result.cameras.push_back(*std::move(solved));
  }
  for (std::size_t i = 1; i < result.cameras.size(); ++i) {
    const CameraResult &first = result.cameras.front(), &second = result.cameras[i];
    calib::PairOutcome pair =
        calib::solveCameraPair(board, {first.camera, Stream::kColor, first.intrinsics.camera},
                               {second.camera, Stream::kColor, second.intrinsics.camera}, observations);
    if (pair.solution) {
      result.camera_pairs.push_back(*std::move(pair.solution));
    } else if (!has_robot || pair.status != calib::PairStatus::kNoCommonView) {
      result.missing.push_back("pose of " + second.camera + " in " + first.camera + ": " + calib::toString(pair.status));
    }
  }
  JointAnswer joint = solveJointly(board, observations, kept, options);
  for (CameraResult& camera : result.cameras) {
    solveDepth(board, observations, options, joint, camera, result.missing);
    addAffineBaseline(board, observations, camera);
  }
  result.joint = std::move(joint.result);
  result.joint_problem = std::move(joint.problem);
  result.goal_met = result.missing.empty();
  return result;
}

}  // namespace servocal::procedure
