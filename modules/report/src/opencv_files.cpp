// SPDX-License-Identifier: GPL-3.0-or-later
// Files that OpenCV's FileStorage reads: OpenCV's own programs' keys, and iai_kinect2's.
#include <cmath>

#include "depth_shift.h"
#include "formats.h"
#include "number_text.h"
#include "rig.h"

namespace servocal::report {
namespace {

constexpr const char* kHeader = "%YAML:1.0\n---\n";

std::string entry(const std::string& key, const Eigen::MatrixXd& matrix) {
  return key + ": !!opencv-matrix\n   rows: " + std::to_string(matrix.rows()) +
         "\n   cols: " + std::to_string(matrix.cols()) + "\n   dt: d\n   data: [ " + numbers(matrix) + " ]\n";
}

Eigen::Matrix3d cameraMatrix(const CameraModel& model) {
  Eigen::Matrix3d k;
  k << model.fx(), 0, model.cx(), 0, model.fy(), model.cy(), 0, 0, 1;
  return k;
}

Eigen::MatrixXd distortion(const CameraModel& model) {
  return model.parameters.tail(model.parameters.size() - 4).transpose();
}

std::string cameraText(const RigCamera& camera, const Rig& rig) {
  std::string text = kHeader;
  text += "image_width: " + std::to_string(camera.model.width_px) +
          "\nimage_height: " + std::to_string(camera.model.height_px) + "\n" +
          entry("camera_matrix", cameraMatrix(camera.model)) +
          entry("distortion_coefficients", distortion(camera.model)) +
          "avg_reprojection_error: " + number(camera.rms_px) + "\n";
  const auto pose = rig.poseOf(camera.optical_frame);
  if (!pose || pose->root == camera.optical_frame) return text;
  return text +
         "# parent_from_camera takes points (m) of the child frame to the parent frame.\nparent_frame: \"" +
         pose->root + "\"\nchild_frame: \"" + camera.optical_frame + "\"\n" +
         entry("parent_from_camera", pose->root_by_camera.matrix());
}

Eigen::Matrix3d crossMatrix(const Eigen::Vector3d& t) {
  Eigen::Matrix3d m;
  m << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  return m;
}

/// Essential and fundamental matrix of second_by_first: x2' E x1 = 0 and p2' F p1 = 0.
struct Epipolar {
  Eigen::Matrix3d essential;
  Eigen::Matrix3d fundamental;
};

Epipolar epipolar(const Eigen::Isometry3d& second_by_first, const CameraModel& first,
                  const CameraModel& second) {
  Epipolar result;
  result.essential = crossMatrix(second_by_first.translation()) * second_by_first.linear();
  result.fundamental =
      cameraMatrix(second).inverse().transpose() * result.essential * cameraMatrix(first).inverse();
  const double last = result.fundamental(2, 2);
  if (std::abs(last) > 0.0) result.fundamental /= last;  // as OpenCV scales it
  return result;
}

/// The sample programs' intrinsics and extrinsics of a stereo pair: x_second = R x_first + T.
std::string stereoText(const RigCamera& first, const RigCamera& second,
                       const Eigen::Isometry3d& first_by_second) {
  const Eigen::Isometry3d second_by_first = first_by_second.inverse();
  const Epipolar lines = epipolar(second_by_first, first.model, second.model);
  return kHeader + ("# 1 is " + first.optical_frame + ", 2 is " + second.optical_frame) +
         ". R and T take points (m) of 1 to 2.\n" + entry("M1", cameraMatrix(first.model)) +
         entry("D1", distortion(first.model)) + entry("M2", cameraMatrix(second.model)) +
         entry("D2", distortion(second.model)) + entry("R", second_by_first.linear()) +
         entry("T", second_by_first.translation()) + entry("E", lines.essential) +
         entry("F", lines.fundamental);
}

std::string iaiCamera(const CameraModel& model) {
  Eigen::Matrix4d projection = Eigen::Matrix4d::Identity();
  projection.topLeftCorner<3, 3>() = cameraMatrix(model);
  return kHeader + entry("cameraMatrix", cameraMatrix(model)) +
         entry("distortionCoefficients", distortion(model)) + entry("rotation", Eigen::Matrix3d::Identity()) +
         entry("projection", projection);
}

}  // namespace

Export exportOpenCv(const CalibrationResult& result, const ExportOptions& options) {
  const Rig rig = opticalRig(result, options);
  Export exported = complete();
  for (const RigCamera& camera : rig.cameras) {
    exported.files.push_back({camera.name + ".yaml", cameraText(camera, rig)});
    const auto pose = rig.poseOf(camera.optical_frame);
    const bool placed = pose && pose->root != camera.optical_frame;
    exported.notes.push_back(camera.name + ".yaml: " + camera.optical_frame +
                             (placed ? " in " + pose->root + " (parent_from_camera)" : ", stands nowhere"));
  }
  const auto addStereo = [&](const RigCamera* first, const RigCamera* second, const Eigen::Isometry3d& pose) {
    if (first == nullptr || second == nullptr || !pose.matrix().allFinite()) return;
    const std::string name = "stereo_" + first->name + "_" + second->name + ".yaml";
    exported.files.push_back({name, stereoText(*first, *second, pose)});
    exported.notes.push_back(name + ": R and T take points of " + first->optical_frame + " to " +
                             second->optical_frame + ", as stereoCalibrate's do");
  };
  for (const CameraResult& camera : result.cameras) {
    if (!camera.color_infrared) continue;
    addStereo(rig.find(camera.camera, Stream::kColor), rig.find(camera.camera, Stream::kInfrared),
              camera.color_infrared->first_by_second);
  }
  for (const CameraPair& pair : result.camera_pairs) {
    addStereo(rig.find(pair.first, Stream::kColor), rig.find(pair.second, Stream::kColor),
              pair.first_by_second);
  }
  return exported;
}

Export exportIaiKinect2(const CalibrationResult& result, const ExportOptions&) {
  Export exported = complete();
  for (const CameraResult& camera : result.cameras) {
    if (!camera.infrared || !camera.color_infrared) {
      return refused("camera '" + camera.camera +
                     "' has no infrared calibration beside its color; iai_kinect2's files "
                     "hold both");
    }
    if (camera.intrinsics.camera.lens != LensModel::kPlumbBob ||
        camera.infrared->camera.lens != LensModel::kPlumbBob) {
      return refused("camera '" + camera.camera +
                     "' has the rational lens model; iai_kinect2's files hold five distortion "
                     "coefficients. Solve again with servocal-solve --lens plumb_bob");
    }
    const Eigen::Isometry3d& cMi = camera.color_infrared->first_by_second;
    const Epipolar lines = epipolar(cMi, camera.infrared->camera, camera.intrinsics.camera);
    const std::filesystem::path folder = camera.camera;
    exported.files.push_back({folder / "calib_color.yaml", iaiCamera(camera.intrinsics.camera)});
    exported.files.push_back({folder / "calib_ir.yaml", iaiCamera(camera.infrared->camera)});
    exported.files.push_back({folder / "calib_pose.yaml", kHeader + entry("rotation", cMi.linear()) +
                                                              entry("translation", cMi.translation()) +
                                                              entry("essential", lines.essential) +
                                                              entry("fundamental", lines.fundamental)});
    exported.notes.push_back(camera.camera +
                             "/calib_pose.yaml: rotation and translation (m) take points of the infrared "
                             "camera to the color camera; name the folder after the Kinect's serial number");
    if (!camera.depth) {
      exported.notes.push_back(camera.camera + ": no depth correction in the result, so no calib_depth.yaml");
      continue;
    }
    const DepthShift shift = fitDepthShift(camera.depth->model);
    const std::string said = "one shift of " + shortNumber(shift.shift_m * 1e3) +
                             " mm for the whole correction leaves " + shortNumber(shift.rms_m * 1e3) +
                             " mm RMS, " + shortNumber(shift.max_m * 1e3) +
                             " mm at most, over the image and " + shortNumber(camera.depth->model.near_m) +
                             " to " + shortNumber(camera.depth->model.far_m) + " m";
    exported.files.push_back({folder / "calib_depth.yaml", kHeader + ("# " + said) + "\ndepthShift: " +
                                                               number(shift.shift_m * 1e3) + "\n"});
    exported.notes.push_back(camera.camera + "/calib_depth.yaml is an approximation: " + said);
  }
  return exported;
}

}  // namespace servocal::report
