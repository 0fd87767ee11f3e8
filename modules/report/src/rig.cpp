// SPDX-License-Identifier: GPL-3.0-or-later
#include "rig.h"

#include <algorithm>

namespace servocal::report {
namespace {

std::string opticalFrame(const std::string& camera, Stream stream) {
  return camera + "_" + toString(stream) + "_optical_frame";
}

void addCamera(Rig& rig, const std::string& camera, Stream stream, const IntrinsicsResult& intrinsics) {
  rig.cameras.push_back({camera, stream, camera + "_" + toString(stream), opticalFrame(camera, stream),
                         intrinsics.camera, intrinsics.rms_px});
}

std::vector<RigCamera> camerasOf(const CalibrationResult& result) {
  Rig rig;
  for (const CameraResult& camera : result.cameras) {
    addCamera(rig, camera.camera, Stream::kColor, camera.intrinsics);
    if (camera.infrared) addCamera(rig, camera.camera, Stream::kInfrared, *camera.infrared);
  }
  return rig.cameras;
}

const std::string& carrier(Mount mount, const ExportOptions& options) {
  return mount == Mount::kFixed ? options.base_frame : options.flange_frame;
}

bool isPose(const Eigen::Isometry3d& pose) { return pose.matrix().allFinite(); }

/// What carries the color camera: base, flange, or the color camera that it was calibrated with.
std::optional<FrameEdge> colorEdge(const CalibrationResult& result, const CameraResult& camera,
                                   const ExportOptions& options) {
  const std::string frame = opticalFrame(camera.camera, Stream::kColor);
  if (camera.hand_eye && isPose(camera.hand_eye->camera_pose)) {
    const bool fixed = camera.hand_eye->mount == Mount::kFixed;
    return FrameEdge{carrier(camera.hand_eye->mount, options), frame, camera.hand_eye->camera_pose,
                     fixed ? "calibrated, bMc" : "calibrated, eMc"};
  }
  for (const CameraPair& pair : result.camera_pairs) {
    if (pair.second == camera.camera && isPose(pair.first_by_second)) {
      return FrameEdge{opticalFrame(pair.first, Stream::kColor), frame, pair.first_by_second,
                       "calibrated beside the other camera"};
    }
  }
  return std::nullopt;
}

std::optional<FrameEdge> infraredEdge(const CameraResult& camera, const ExportOptions& options) {
  const std::string frame = opticalFrame(camera.camera, Stream::kInfrared);
  if (camera.color_infrared && isPose(camera.color_infrared->first_by_second)) {
    return FrameEdge{opticalFrame(camera.camera, Stream::kColor), frame,
                     camera.color_infrared->first_by_second, "calibrated, cMi"};
  }
  if (camera.infrared_hand_eye && isPose(camera.infrared_hand_eye->camera_pose)) {
    const bool fixed = camera.infrared_hand_eye->mount == Mount::kFixed;
    return FrameEdge{carrier(camera.infrared_hand_eye->mount, options), frame,
                     camera.infrared_hand_eye->camera_pose, fixed ? "calibrated, bMi" : "calibrated, eMi"};
  }
  return std::nullopt;
}

}  // namespace

Eigen::Isometry3d linkByOptical() {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return pose;
}

std::string linkFrame(const std::string& camera, const ExportOptions& options) {
  const auto driver = options.drivers.find(camera);
  return driver == options.drivers.end() ? camera + "_link" : driver->second.frame;
}

std::optional<RootPose> Rig::poseOf(const std::string& frame) const {
  RootPose pose{frame, Eigen::Isometry3d::Identity()};
  bool placed = false;
  for (auto edge = edges.rbegin(); edge != edges.rend(); ++edge) {  // children come after their parents
    if (edge->child != pose.root) continue;
    pose.root = edge->parent;
    pose.root_by_camera = edge->parent_by_child * pose.root_by_camera;
    placed = true;
  }
  const bool is_root =
      std::any_of(edges.begin(), edges.end(), [&](const auto& edge) { return edge.parent == frame; });
  if (!placed && !is_root) return std::nullopt;
  return pose;
}

const RigCamera* Rig::find(const std::string& camera, Stream stream) const {
  for (const RigCamera& candidate : cameras) {
    if (candidate.camera == camera && candidate.stream == stream) return &candidate;
  }
  return nullptr;
}

Rig opticalRig(const CalibrationResult& result, const ExportOptions& options) {
  Rig rig{camerasOf(result), {}};
  for (const CameraResult& camera : result.cameras) {
    if (const auto edge = colorEdge(result, camera, options)) rig.edges.push_back(*edge);
    if (!camera.infrared) continue;
    if (const auto edge = infraredEdge(camera, options)) rig.edges.push_back(*edge);
  }
  return rig;
}

Rig linkedRig(const CalibrationResult& result, const ExportOptions& options) {
  Rig rig{camerasOf(result), {}};
  for (const CameraResult& camera : result.cameras) {
    const auto driver = options.drivers.find(camera.camera);
    const bool driven = driver != options.drivers.end();
    const Eigen::Isometry3d link_by_optical = driven ? driver->second.frame_by_optical : linkByOptical();
    const std::string link = linkFrame(camera.camera, options);
    if (auto edge = colorEdge(result, camera, options)) {
      edge->child = link;
      edge->parent_by_child = edge->parent_by_child * link_by_optical.inverse();
      edge->about += driven ? "; the frame from which the driver publishes the optical frames"
                            : "; in the color camera's centre, x forward, y left, z up";
      rig.edges.push_back(*edge);
    }
    if (driven) continue;
    rig.edges.push_back(
        {link, opticalFrame(camera.camera, Stream::kColor), link_by_optical, "x right, y down, z forward"});
    if (!camera.infrared) continue;
    if (const auto edge = infraredEdge(camera, options)) rig.edges.push_back(*edge);
  }
  return rig;
}

}  // namespace servocal::report
