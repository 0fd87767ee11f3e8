// SPDX-License-Identifier: GPL-3.0-or-later
// ROS: camera_info (camera_calibration_parsers' YAML) and easy_handeye2's calibration files.
#include "formats.h"
#include "number_text.h"
#include "rig.h"

namespace servocal::report {
namespace {

std::string infoMatrix(const char* key, const Eigen::MatrixXd& matrix) {
  return std::string(key) + ":\n  rows: " + std::to_string(matrix.rows()) +
         "\n  cols: " + std::to_string(matrix.cols()) + "\n  data: [" + numbers(matrix) + "]\n";
}

std::string cameraInfo(const RigCamera& camera) {
  const CameraModel& model = camera.model;
  Eigen::Matrix<double, 3, 4> projection = Eigen::Matrix<double, 3, 4>::Zero();
  projection.leftCols<3>() << model.fx(), 0, model.cx(), 0, model.fy(), model.cy(), 0, 0, 1;
  const Eigen::RowVectorXd distortion = model.parameters.tail(model.parameters.size() - 4).transpose();
  return "image_width: " + std::to_string(model.width_px) +
         "\nimage_height: " + std::to_string(model.height_px) + "\ncamera_name: " + camera.name + "\n" +
         infoMatrix("camera_matrix", projection.leftCols<3>()) + "distortion_model: " + toString(model.lens) +
         "\n" + infoMatrix("distortion_coefficients", distortion) +
         infoMatrix("rectification_matrix", Eigen::Matrix3d::Identity()) +
         infoMatrix("projection_matrix", projection);
}

std::string vectorBlock(const Eigen::VectorXd& values) {
  static const char* names[] = {"x", "y", "z", "w"};
  std::string text;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    text += std::string("    ") + names[i] + ": " + number(values[i]) + "\n";
  }
  return text;
}

}  // namespace

Export exportRosCameraInfo(const CalibrationResult& result, const ExportOptions& options) {
  Export exported = complete();
  for (const RigCamera& camera : opticalRig(result, options).cameras) {
    exported.files.push_back({camera.name + ".yaml", cameraInfo(camera)});
    exported.notes.push_back(camera.name + ".yaml belongs to images stamped with frame " +
                             camera.optical_frame);
  }
  return exported;
}

Export exportEasyHandEye2(const CalibrationResult& result, const ExportOptions& options) {
  Export exported = complete();
  for (const CameraResult& camera : result.cameras) {
    if (!camera.hand_eye) continue;
    const bool fixed = camera.hand_eye->mount == Mount::kFixed;
    const auto driver = options.drivers.find(camera.camera);
    const bool driven = driver != options.drivers.end();
    Eigen::Isometry3d pose = camera.hand_eye->camera_pose;
    if (driven) pose = pose * driver->second.frame_by_optical.inverse();
    const std::string child = driven ? driver->second.frame : camera.camera + "_color_optical_frame";
    const std::string& parent = fixed ? options.base_frame : options.flange_frame;
    const std::string name = camera.camera + ".calib";
    exported.files.push_back(
        {name, "parameters:\n  name: " + camera.camera + "\n  calibration_type: " +
                   (fixed ? "eye_on_base" : "eye_in_hand") + "\n  robot_base_frame: " + options.base_frame +
                   "\n  robot_effector_frame: " + options.flange_frame + "\n  tracking_base_frame: " + child +
                   "\n  tracking_marker_frame: " + options.board_frame +
                   "\n  freehand_robot_movement: true\n  move_group_namespace: /\n  move_group: manipulator\n"
                   "transform:\n  translation:\n" +
                   vectorBlock(pose.translation()) + "  rotation:\n" +
                   vectorBlock(Eigen::Quaterniond(pose.linear()).normalized().coeffs())});
    exported.notes.push_back(name + ": " + child + " in " + parent);
    if (!driven) {
      exported.notes.push_back(name + " gives " + child +
                               " a parent; if the camera's driver already does, name its "
                               "topmost frame with --driver, or tf has two");
    }
  }
  if (exported.files.empty())
    return refused("no camera has a pose on the robot (hand_eye); easy_handeye2 holds only that");
  return exported;
}

}  // namespace servocal::report
