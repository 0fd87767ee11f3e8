// SPDX-License-Identifier: GPL-3.0-or-later
#include "trial.h"

#include <chrono>
#include <ctime>

#include "reachable_cells.h"
#include "servocal/calib/board_pose.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/procedure/solve.h"
#include "servocal/robot/guard.h"
#include "servocal/session/session.h"
#include "servocal/sim/cell.h"
#include "sim_truth.h"

namespace servocal::test {
namespace {

double cpuSeconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// What a user of the result does: sees a board, wants its corners in the base.
double boardPointErrorM(const CameraResult& camera, const BoardSpec& board, const CameraModel& true_camera,
                        const Pose<Base, Color>& true_bMc, const Pose<Color, Board>& true_cMo) {
  BoardDetection seen;
  seen.orientation_known = true;
  for (int id = 0; id < board.cornerCount(); ++id) {
    const auto pixel = true_camera.project(true_cMo * board.corner(id));
    if (pixel) seen.corners.push_back({id, *pixel, 0.01 * Eigen::Matrix2d::Identity()});
  }
  const auto poses = calib::boardPoses(board, camera.intrinsics.camera, seen);
  if (poses.empty()) return std::numeric_limits<double>::infinity();
  const Pose<Base, Color> bMc(camera.hand_eye->camera_pose);
  double sum = 0.0;
  for (const Eigen::Vector3d& corner : board.corners()) {
    sum += (bMc * (poses.front().cMo * corner) - true_bMc * (true_cMo * corner)).squaredNorm();
  }
  return std::sqrt(sum / board.cornerCount());
}

/// RMS over the image of what is left of the depth error; nothing without ranges.
std::optional<double> depthErrorM(const sim::Truth& truth, const std::string& camera, const DepthModel& model,
                                  bool corrected, double near_m, double far_m) {
  if (far_m <= near_m) return std::nullopt;
  double sum = 0.0;
  int count = 0;
  for (int i = 0; i < 8 * 6 * 5; ++i) {
    const Eigen::Vector2d pixel((i % 8 + 0.5) / 8 * model.camera.width_px - 0.5,
                                (i / 8 % 6 + 0.5) / 6 * model.camera.height_px - 0.5);
    const double z_m = near_m + (far_m - near_m) * (i / 48) / 4;
    const double measured_m = truth.measuredDepth(camera, pixel, z_m);
    const auto corrected_m = corrected ? model.correct(pixel, measured_m) : std::optional(measured_m);
    if (!corrected_m) continue;
    sum += (*corrected_m - z_m) * (*corrected_m - z_m);
    ++count;
  }
  return std::sqrt(sum / count);
}

/// In the base, or in the flange if the camera rides on it.
Pose<Base, Color> truePose(const sim::Truth& truth, const CameraResult& camera, Instant now) {
  if (camera.hand_eye->mount == Mount::kFixed) return truth.bMc(camera.camera, now);
  return relabel<Base, Color>(truth.eMc(camera.camera, now));
}

CameraErrors errorsOf(const sim::Truth& truth, const CameraResult& camera, Instant now) {
  CameraErrors errors;
  errors.camera = camera.camera;
  const Pose<Base, Color> bMc(camera.hand_eye->camera_pose), true_bMc = truePose(truth, camera, now);
  errors.pose_m = distanceM(bMc, true_bMc);
  errors.pose_rad = angleRad(bMc, true_bMc);
  if (camera.color_infrared) {
    const Pose<Color, Infrared> cMi(camera.color_infrared->first_by_second),
        true_cMi = truth.cMi(camera.camera);
    errors.infrared_m = distanceM(cMi, true_cMi);
    errors.infrared_rad = angleRad(cMi, true_cMi);
  }
  if (camera.depth) {
    const DepthModel& model = camera.depth->model;
    errors.depth_before_m = depthErrorM(truth, camera.camera, model, false, model.near_m, model.far_m);
    errors.depth_after_m = depthErrorM(truth, camera.camera, model, true, model.near_m, model.far_m);
    errors.depth_beyond_m = depthErrorM(truth, camera.camera, model, true, model.far_m, 1.5);
  }
  return errors;
}

/// The joint estimate with the arm as it reports.
std::optional<JointResult> solveWithoutArm(const CellConfig& cell,
                                           const std::vector<Observation>& observations) {
  procedure::SolveOptions options;
  options.mount = cell.cameras.front().mount;
  options.robot_sigma_m = cell.arm.accuracy_m;
  options.robot_sigma_rad = cell.arm.accuracy_rad;
  return procedure::solve(cell.board, observations, options).joint;
}

}  // namespace

std::vector<CameraErrors> cameraErrors(sim::Cell& cell, const CalibrationResult& result) {
  const sim::Truth truth(cell);
  std::vector<CameraErrors> errors;
  for (const CameraResult& camera : result.cameras) {
    if (camera.hand_eye) errors.push_back(errorsOf(truth, camera, cell.clock().now()));
  }
  return errors;
}

Trial runTrial(const CellConfig& cell, std::uint64_t seed, const std::filesystem::path& folder,
               const procedure::CalibrateOptions& options, bool also_without_arm) {
  const auto wall_begin = std::chrono::steady_clock::now();
  const double cpu_begin = cpuSeconds();
  sim::Cell simulation(cell, seed);
  const robot::Kinematics kinematics(cell.arm);
  Trial trial;
  std::vector<Observation> observations;
  {
    robot::Guard guard(simulation.arm(), kinematics, simulation.clock(), cell);
    procedure::Devices devices{simulation.clock(), guard, {}};
    for (const CameraConfig& camera : cell.cameras)
      devices.cameras.push_back(&simulation.camera(camera.name));
    auto session = session::Session::create(folder, cell.text, cell.board, seed);
    trial.result = procedure::calibrate(cell, devices, session, {}, options);
    for (const Attempt& attempt : session.attempts()) {
      trial.target_losses += attempt.stage != "tilt" && attempt.status == DriveStatus::kTargetLost;
    }
    observations = session.observations();
    for (const Observation& observation : observations) {
      trial.coverage_views += observation.stage == "cover";
    }
    trial.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - wall_begin).count();
    trial.cpu_s = cpuSeconds() - cpu_begin;
    trial.plane_shots = shootPlanes(cell, trial.result, simulation, guard);
  }

  // From here on the truth is read, after the run has ended.
  const sim::Truth truth(simulation);
  trial.errors = cameraErrors(simulation, trial.result);
  trial.pairs = pairErrors(truth, trial.result, trial.plane_shots,
                           kinematics.forward(cell.arm.start_q) * truth.eMo().translation());
  if (trial.result.joint) trial.joint_errors = jointErrors(cell, truth, *trial.result.joint, observations);
  if (also_without_arm) {
    const auto joint = solveWithoutArm(cell, observations);
    if (joint) trial.without_arm = jointErrors(cell, truth, *joint, observations);
  }
  const std::string& name = cell.cameras.front().name;
  // The rest is about what a UR5 can reach for a camera in the cell.
  if (cell.cameras.front().mount == Mount::kFlange || cell.arm.urdf != "ur5") return trial;
  const ReachableCells reachable = reachableCells(cell, truth, name);
  trial.cells = static_cast<int>(reachable.cells.size());
  trial.reachable_cells = reachable.count();
  if (trial.result.cameras.empty() || !trial.result.cameras.front().hand_eye) return trial;
  const CameraResult& camera = trial.result.cameras.front();
  if (camera.coverage) {
    for (int i = 0; i < trial.cells; ++i) {
      trial.filled_reachable_cells +=
          reachable.cells[i].has_value() &&
          camera.coverage->corners_per_cell[i] >= camera.coverage->corners_to_fill;
    }
  }
  const Pose<Base, Color> bMc(camera.hand_eye->camera_pose), true_bMc = truth.bMc(name);
  trial.camera_error_m = distanceM(bMc, true_bMc);
  trial.camera_error_rad = angleRad(bMc, true_bMc);
  const double z = cell.coverage.near_distance_m;
  const std::array<Eigen::Vector3d, 5> places = {{{0, 0, z},
                                                  {-0.3 * z, -0.15 * z, z},
                                                  {0.3 * z, -0.15 * z, z},
                                                  {-0.4 * z, 0.2 * z, 1.4 * z},
                                                  {0.4 * z, 0.2 * z, 1.4 * z}}};
  for (std::size_t i = 0; i < places.size(); ++i) {
    const auto cMo = Pose<Color, Board>::fromRotationVector({0.4, -0.3, 0.1}, places[i]);
    trial.board_point_error_m[i] = boardPointErrorM(camera, cell.board, truth.camera(name), true_bMc, cMo);
  }
  return trial;
}

}  // namespace servocal::test
