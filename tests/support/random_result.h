// SPDX-License-Identifier: GPL-3.0-or-later
// A calibration result in which every field that there is says something, from a written seed.
#pragma once

#include <cmath>
#include <random>
#include <string>

#include "poses.h"
#include "servocal/core/result.h"

namespace servocal::test {

/// Numbers are plausible, not consistent with each other: nothing was calibrated.
class RandomResult {
 public:
  explicit RandomResult(std::uint64_t seed) : random_(seed) {}

  CalibrationResult make(int cameras) {
    CalibrationResult result;
    result.goal_met = false;
    result.missing = {"cam1: 3 of 40 image cells are not filled: \"corner\", \xC3\xA4\n"};
    result.provenance = "servocal-test, seed 7";
    result.board.pattern = Checkerboard{7, 5, 0.03, true, 0.6};
    result.observations = 40;
    result.motion_time_s = 100.0 / 3;
    result.tilt_time_s = 20.0 / 7;
    for (int i = 0; i < cameras; ++i) result.cameras.push_back(camera("cam" + std::to_string(i + 1), i));
    for (int i = 1; i < cameras; ++i)
      result.camera_pairs.push_back(pair("cam1", "cam" + std::to_string(i + 1)));
    result.joint = joint(result);
    result.joint_problem = "what a result without a joint estimate says";
    return result;
  }

  IntrinsicsResult intrinsics(LensModel lens, int width_px, int height_px, double focal_px) {
    IntrinsicsResult result;
    CameraModel& model = result.camera;
    model.lens = lens;
    model.width_px = width_px;
    model.height_px = height_px;
    model.parameters.resize(parameterCount(lens));
    model.parameters.head<4>() << focal_px * (1 + near(0.01)), focal_px * (1 + near(0.01)),
        0.5 * width_px + near(10), 0.5 * height_px + near(10);
    model.parameters.segment<5>(4) << 0.09 + near(0.01), -0.12 + near(0.01), near(1e-3), near(1e-3),
        0.03 + near(0.01);
    if (lens == LensModel::kRational) model.parameters.tail<3>() << near(0.02), near(0.02), near(0.02);
    const Eigen::Index n = model.parameters.size();
    Eigen::MatrixXd root(n, n);
    for (double& entry : root.reshaped()) entry = near(0.1);
    result.covariance = root * root.transpose();
    result.sigma = result.covariance.diagonal().cwiseSqrt();
    result.rms_px = 0.1 + near(0.05);
    result.corners = 720;
    result.views = views();
    return result;
  }

  HandEyeSolution handEye(Mount mount) {
    HandEyeSolution solution;
    solution.mount = mount;
    solution.camera_pose = randomPose<Base, Color>(random_, 3.0, 1.0).isometry();
    solution.board_pose = randomPose<EndEffector, Board>(random_, 3.0, 0.1).isometry();
    for (int i = 0; i < 6; ++i) solution.camera_sigma[i] = 5e-4 + near(4e-4);
    for (int i = 0; i < 6; ++i) solution.board_sigma[i] = 5e-4 + near(4e-4);
    solution.rms_px = 0.2 + near(0.1);
    solution.robot_rms_m = 2e-4 + near(1e-4);
    solution.robot_rms_rad = 2e-4 + near(1e-4);
    solution.scatter_m = 5e-4 + near(1e-4);
    solution.scatter_rad = 5e-4 + near(1e-4);
    solution.symmetric_views = 3;
    solution.resolved_turns = 2;
    solution.resolved_flips = 1;
    solution.views = views();
    return solution;
  }

 private:
  double near(double half_range) {
    return std::uniform_real_distribution<double>(-half_range, half_range)(random_);
  }

  std::vector<ViewResidual> views() {
    return {{1, "bootstrap", 0.1 + near(0.05), true, "", ViewCause::kNone},
            {2, "cover", 0.2 + near(0.05), true, "", ViewCause::kNone},
            {3000000000, "b.png", 9 + near(1), false, "no board found", ViewCause::kNoBoard}};
  }

  CameraPair pair(const std::string& first, const std::string& second) {
    CameraPair result;
    result.first = first;
    result.second = second;
    result.first_by_second = randomPose<Color, Color>(random_, 1.0, 0.3).isometry();
    Eigen::Matrix<double, 6, 6> root;
    for (double& entry : root.reshaped()) entry = near(1e-3);
    result.covariance = root * root.transpose();
    result.rms_px = 0.2 + near(0.1);
    result.views = views();
    return result;
  }

  CoverageSummary coverage() {
    CoverageSummary summary;
    summary.cells_x = 3;
    summary.cells_y = 2;
    summary.corners_per_cell = {12, 13, 0, 55, 12, 14};
    summary.unreachable = {false, false, true, false, false, false};
    summary.corners_to_fill = 12;
    summary.near_views = 20;
    summary.far_views = 11;
    summary.tilt_bins = {{"facing", 5}, {"roll+", 4}};
    summary.out_of_reach = {"far views", "tilt yaw-"};
    return summary;
  }

  DepthResult depth(DepthSensor sensor, const CameraModel& infrared) {
    DepthResult result;
    result.model.sensor = sensor;
    result.model.camera = infrared;
    result.model.offset = near(0.02);
    result.model.slope = 1 + near(0.01);
    result.model.nodes_x = 3;
    result.model.nodes_y = 2;
    result.model.nodes.resize(6);
    for (double& node : result.model.nodes) node = near(0.01);
    if (sensor == DepthSensor::kTimeOfFlight) {
      result.model.wiggle.resize(5);
      for (double& node : result.model.wiggle) node = near(0.002);
      result.model.wiggle_from_m = 0.3;
      result.model.wiggle_to_m = 1.9;
    }
    result.model.near_m = 0.5;
    result.model.far_m = 1.7;
    result.rms_before_m = 0.02 + near(0.01);
    result.rms_after_m = 0.002 + near(0.001);
    result.sigma_at_m = Eigen::Vector4d(0.5, 1.1, 1.7, 1.5);
    result.sigma_m = Eigen::Vector4d(1e-3, 5e-4, 1e-3, 8e-4) * (1 + near(0.1));
    result.views = 30;
    result.patches = 1200;
    result.notes = {"the lattice has 3 x 2 nodes: the patches do not carry more"};
    return result;
  }

  CameraResult camera(const std::string& name, int index) {
    CameraResult result;
    result.camera = name;
    result.intrinsics =
        intrinsics(index == 0 ? LensModel::kPlumbBob : LensModel::kRational, 1920, 1080, 1066);
    result.intrinsics_with_outliers = intrinsics(result.intrinsics.camera.lens, 1920, 1080, 1066);
    result.hand_eye = handEye(index < 2 ? Mount::kFixed : Mount::kFlange);
    result.hand_eye_with_outliers = handEye(result.hand_eye->mount);
    result.board_scale = BoardScale{1.0 + near(1e-3), 1e-4 + near(1e-5)};
    result.notes = {"a note"};
    result.coverage = coverage();
    for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
      for (const char* direction : {"roll+", "roll-", "pitch+", "pitch-", "yaw+", "yaw-"}) {
        result.tilt_limits.push_back({direction, 0.7 + near(0.2), "detection", stream});
      }
    }
    result.infrared = intrinsics(LensModel::kPlumbBob, 512, 424, 366);
    result.infrared_hand_eye = handEye(result.hand_eye->mount);
    result.color_infrared = pair(name, name);
    result.color_infrared->first_by_second = randomPose<Color, Infrared>(random_, 0.02, 0.05).isometry();
    result.depth = depth(index == 1 ? DepthSensor::kStructuredLight : DepthSensor::kTimeOfFlight,
                         result.infrared->camera);
    result.infrared_coverage = coverage();
    result.combined_views = 25;
    AffineEyeToHand affine;
    for (double& entry : affine.bAc.reshaped()) entry = near(1.0);
    affine.rms_m = 0.004 + near(0.001);
    affine.inliers = 600;
    affine.points = 720;
    result.affine_baseline = affine;
    result.held_out = HeldOut{3, 0.2 + near(0.1), 2e-4 + near(1e-4)};
    result.time_offset_s = near(0.05);
    result.time_offset_sigma_s = 1e-3 + near(1e-4);
    return result;
  }

  ProjectionMap projection() {
    ProjectionMap map{3, 2, {}, 0.3 + near(0.1), 0.2 + near(0.1)};
    for (int i = 0; i < 6; ++i) map.sigma_px.push_back(0.2 + near(0.1));
    return map;
  }

  JointCameraResult jointCamera(const std::string& name, Stream stream, const CameraModel& model) {
    JointCameraResult camera;
    camera.camera = name;
    camera.stream = stream;
    camera.model = model;
    camera.sigma = Eigen::VectorXd::Constant(model.parameters.size(), 0.1 + near(0.05));
    camera.sigma[8] = 0;
    camera.pose = randomPose<Base, Color>(random_, 3.0, 1.0).isometry();
    Eigen::Matrix<double, 6, 6> root;
    for (double& entry : root.reshaped()) entry = near(1e-3);
    camera.pose_covariance = root * root.transpose();
    camera.rms_px = 0.2 + near(0.1);
    camera.corner_scale = 1.1 + near(0.1);
    camera.views = 31;
    camera.range_m = 0.6 + near(0.1);
    camera.at_infinity = projection();
    camera.at_range = projection();
    camera.workspace = {2, 2, 3, {}, 1e-3 + near(1e-4), 5e-4 + near(1e-4), 12};
    for (int i = 0; i < 12; ++i) camera.workspace.sigma_m.push_back(5e-4 + near(1e-4));
    if (stream == Stream::kColor) camera.halves = JointHalves{0.1 + near(0.05), 0.2 + near(0.1)};
    return camera;
  }

  JointPair jointPair(const JointCameraResult& first, const JointCameraResult& second) {
    const CameraPair beside = pair(first.camera, second.camera);
    return {first.camera,    first.stream,          second.camera,     second.stream,      beside.first_by_second,
            beside.covariance, 1e-3 + near(1e-4), 5e-4 + near(1e-4), 12};
  }

  JointResult joint(const CalibrationResult& result) {
    JointResult out;
    for (const CameraResult& camera : result.cameras) {
      out.cameras.push_back(jointCamera(camera.camera, Stream::kColor, camera.intrinsics.camera));
      out.cameras.push_back(jointCamera(camera.camera, Stream::kInfrared, camera.infrared->camera));
    }
    out.mount = result.cameras.front().hand_eye->mount;
    for (std::size_t i = 0; i < out.cameras.size(); i += 2) {
      out.pairs.push_back(jointPair(out.cameras[i], out.cameras[i + 1]));
      for (std::size_t k = i + 2; k < out.cameras.size(); k += 2)
        out.pairs.push_back(jointPair(out.cameras[i], out.cameras[k]));
    }
    out.board_pose = randomPose<EndEffector, Board>(random_, 3.0, 0.1).isometry();
    for (int i = 0; i < 6; ++i) out.board_sigma[i] = 5e-4 + near(4e-4);
    out.board_scale_x = 1 + near(1e-3);
    out.board_scale_y = 1 + near(1e-3);
    out.board_bow_x_m = near(1e-4);
    out.board_bow_y_m = near(1e-4);
    out.robot_sigma_m = 2e-4 + near(1e-4);
    out.robot_sigma_rad = 3e-4 + near(1e-4);
    out.declared_sigma_m = 3e-4;
    out.declared_sigma_rad = 5e-4;
    out.robot_terms = {{"joint 2 offset (rad)", near(1e-3)}, {"link 2 length (m)", near(1e-3)}};
    out.model = "Supported by the views held out: errors of the arm's geometry.";
    out.open = {"the turn of the board is open"};
    out.faults = {"the camera cam1 (color) was moved"};
    out.notes = {"a note"};
    out.held_out = JointHeldOut{9, 0.3 + near(0.1), 3e-4 + near(1e-4), 1 + near(0.1)};
    return out;
  }

  std::mt19937_64 random_;
};

}  // namespace servocal::test
