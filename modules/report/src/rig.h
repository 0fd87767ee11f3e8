// SPDX-License-Identifier: GPL-3.0-or-later
// A result as the export formats see it: a flat list of cameras, and a tree of frames with one parent each.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/report/export.h"

namespace servocal::report {

/// One stream of one camera. Depth shares the infrared's.
struct RigCamera {
  std::string camera;  ///< As in the result.
  Stream stream = Stream::kColor;
  std::string name;           ///< "cam1_color"; file and camera name in every format.
  std::string optical_frame;  ///< "cam1_color_optical_frame": x right, y down, z forward.
  CameraModel model;
  double rms_px = 0.0;  ///< Of its intrinsics.
};

/// `parent` carries `child`: parent_by_child takes points of the child to the parent, m.
struct FrameEdge {
  std::string parent;
  std::string child;
  Eigen::Isometry3d parent_by_child;
  std::string about;  ///< Half a sentence for a comment.
};

/// A camera in the frame at the top of its tree.
struct RootPose {
  std::string root;
  Eigen::Isometry3d root_by_camera;
};

struct Rig {
  std::vector<RigCamera> cameras;
  std::vector<FrameEdge> edges;  ///< Parents before children; no child twice.

  std::optional<RootPose> poseOf(const std::string& frame) const;
  /// The infrared stream of a camera, beside its color stream; nullptr if there is none.
  const RigCamera* find(const std::string& camera, Stream stream) const;
};

/// Optical frames alone: each hangs from base, flange or another optical frame, wherever the result says so.
Rig opticalRig(const CalibrationResult& result, const ExportOptions& options);

/// As robots want it: in between a link per camera, x forward, y left, z up (REP 103), in the color camera's
/// centre. Where a driver publishes the frames of a camera, only its topmost frame is placed.
Rig linkedRig(const CalibrationResult& result, const ExportOptions& options);

/// The driver's own frames in options.drivers, or the link of that name.
std::string linkFrame(const std::string& camera, const ExportOptions& options);

/// Pose of the optical frame in a camera link: z forward along x, x right along -y.
Eigen::Isometry3d linkByOptical();

}  // namespace servocal::report
