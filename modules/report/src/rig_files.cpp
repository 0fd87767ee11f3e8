// SPDX-License-Identifier: GPL-3.0-or-later
// Programs that think in sets of cameras: Kalibr, mrcal, COLMAP.
#include "formats.h"
#include "number_text.h"
#include "rig.h"

namespace servocal::report {
namespace {

/// Why Kalibr's radtan (k1 k2 p1 p2) cannot hold a lens; empty if it can.
std::string kalibrRefusal(const RigCamera& camera) {
  const CameraModel& model = camera.model;
  if (model.lens == LensModel::kRational) {
    return camera.name +
           " has the rational lens model, of which Kalibr's radtan (k1 k2 p1 p2) holds half. Solve again "
           "with servocal-solve --lens plumb_bob --fixed k3";
  }
  if (model.parameters[8] != 0.0) {
    return camera.name + " has k3 = " + shortNumber(model.parameters[8]) +
           " and Kalibr's radtan (k1 k2 p1 p2) has no "
           "k3; leaving it out would bend the image. Solve again with servocal-solve --fixed k3";
  }
  return "";
}

std::string rows4(const Eigen::Matrix4d& matrix) {
  std::string text;
  for (int row = 0; row < 4; ++row) text += "  - [" + numbers(matrix.row(row)) + "]\n";
  return text;
}

std::string topic(const RigCamera& camera) {
  return "/" + camera.camera + "/" + (camera.stream == Stream::kColor ? "color" : "ir") + "/image_raw";
}

}  // namespace

Export exportKalibr(const CalibrationResult& result, const ExportOptions& options) {
  const Rig rig = opticalRig(result, options);
  std::string text = "# T_cn_cnm1 takes points (m) of the camera before to this one, optical frames.\n";
  Export exported = complete();
  std::optional<RootPose> before;
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const RigCamera& camera = rig.cameras[i];
    if (const std::string reason = kalibrRefusal(camera); !reason.empty()) return refused(reason);
    const CameraModel& model = camera.model;
    const std::string name = "cam" + std::to_string(i);
    std::string overlaps;
    for (std::size_t k = 0; k < rig.cameras.size(); ++k) {
      if (k != i) overlaps += (overlaps.empty() ? "" : ", ") + std::to_string(k);
    }
    text += name + ":  # " + camera.name + "\n  cam_overlaps: [" + overlaps +
            "]\n  camera_model: pinhole\n  distortion_coeffs: [" + numbers(model.parameters.segment<4>(4)) +
            "]\n  distortion_model: radtan\n  intrinsics: [" + numbers(model.parameters.head<4>()) +
            "]\n  resolution: [" + std::to_string(model.width_px) + ", " + std::to_string(model.height_px) +
            "]\n  rostopic: " + topic(camera) + "\n";
    const auto pose = rig.poseOf(camera.optical_frame);
    if (i > 0) {
      if (!pose || !before || pose->root != before->root) {
        return refused(camera.name + " does not stand beside " + rig.cameras[i - 1].name +
                       " in one frame, as each "
                       "camera of Kalibr's chain must");
      }
      const Eigen::Isometry3d step = pose->root_by_camera.inverse() * before->root_by_camera;
      text += "  T_cn_cnm1:\n" + rows4(step.matrix());
    }
    exported.notes.push_back(
        "camchain.yaml, " + name + ": " + camera.optical_frame +
        (i == 0 ? std::string()
                : "; T_cn_cnm1 takes points of " + rig.cameras[i - 1].optical_frame + " to it"));
    before = pose;
  }
  exported.files.push_back({"camchain.yaml", text});
  return exported;
}

Export exportMrcal(const CalibrationResult& result, const ExportOptions& options) {
  const Rig rig = opticalRig(result, options);
  Export exported = complete();
  for (const RigCamera& camera : rig.cameras) {
    const auto pose = rig.poseOf(camera.optical_frame);
    const bool placed = pose && pose->root != camera.optical_frame;
    const Eigen::Isometry3d camera_by_root =
        placed ? pose->root_by_camera.inverse() : Eigen::Isometry3d::Identity();
    const Eigen::AngleAxisd turn(Eigen::Quaterniond(camera_by_root.linear()).normalized());
    Eigen::Matrix<double, 6, 1> rt;
    rt << turn.angle() * turn.axis(), camera_by_root.translation();
    const std::string where =
        placed ? "the reference is " + pose->root : "it stands nowhere: the reference is itself";
    const bool rational = camera.model.lens == LensModel::kRational;
    exported.files.push_back({camera.name + ".cameramodel",
                              "# " + camera.optical_frame + "; " + where +
                                  ". extrinsics: rotation vector (rad), translation (m), reference to "
                                  "camera.\n{\n    'lensmodel':  'LENSMODEL_OPENCV" +
                                  (rational ? "8" : "5") + "',\n    'intrinsics': [ " +
                                  numbers(camera.model.parameters) + " ],\n    'extrinsics': [ " +
                                  numbers(rt) + " ],\n    'imagersize': [ " +
                                  std::to_string(camera.model.width_px) + ", " +
                                  std::to_string(camera.model.height_px) + " ],\n}\n"});
    exported.notes.push_back(camera.name + ".cameramodel: " + camera.optical_frame + ", " + where);
  }
  return exported;
}

Export exportColmap(const CalibrationResult& result, const ExportOptions& options) {
  const Rig rig = opticalRig(result, options);
  Export exported = complete();
  std::string cameras =
      "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n"
      "# COLMAP's pixel (0,0) is the corner of the image: half a pixel more than in the result.\n";
  std::string images = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, world to camera; world is " +
                       options.base_frame + ". The points' lines are empty.\n";
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const RigCamera& camera = rig.cameras[i];
    const CameraModel& model = camera.model;
    const std::string id = std::to_string(i + 1);
    Eigen::VectorXd parameters = model.parameters;
    parameters.segment<2>(2).array() += 0.5;
    const bool short_form = model.lens == LensModel::kPlumbBob && parameters[8] == 0.0;
    const Eigen::Index given = parameters.size();
    parameters.conservativeResize(short_form ? 8 : 12);
    for (Eigen::Index k = given; k < parameters.size(); ++k) parameters[k] = 0.0;
    cameras += "# " + camera.name + "\n" + id + (short_form ? " OPENCV " : " FULL_OPENCV ") +
               std::to_string(model.width_px) + " " + std::to_string(model.height_px) + " " +
               numbers(parameters, " ") + "\n";
    const auto pose = rig.poseOf(camera.optical_frame);
    if (!pose || pose->root != options.base_frame) {
      exported.notes.push_back("images.txt lacks " + camera.name + ": it does not stand in " +
                               options.base_frame);
      continue;
    }
    const Eigen::Isometry3d camera_by_world = pose->root_by_camera.inverse();
    const Eigen::Quaterniond q = Eigen::Quaterniond(camera_by_world.linear()).normalized();
    images += id + " " + number(q.w()) + " " + numbers(q.vec(), " ") + " " +
              numbers(camera_by_world.translation(), " ") + " " + id + " " + camera.name + ".png\n\n";
    exported.notes.push_back("images.txt: " + camera.optical_frame + " as image " + camera.name +
                             ".png; the world is " + options.base_frame);
  }
  exported.files.push_back({"cameras.txt", cameras});
  exported.files.push_back({"images.txt", images});
  exported.files.push_back({"points3D.txt", "# No points.\n"});
  return exported;
}

}  // namespace servocal::report
