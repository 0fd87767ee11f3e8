// SPDX-License-Identifier: GPL-3.0-or-later
// What writing and reading a result file have in common; docs/result-schema.md.
#pragma once

#include <string>

#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::session {

constexpr int kResultSchemaVersion = 3;
constexpr int kOldestReadSchemaVersion = 2;  ///< Lacks `joint`, `joint_problem` and `out_of_reach`.
constexpr double kDegPerRad = 180.0 / 3.14159265358979323846;

/// "fx" -> "fx_px"; distortion coefficients have no unit.
inline std::string withUnit(const std::string& parameter) {
  const bool pixels = parameter == "fx" || parameter == "fy" || parameter == "cx" || parameter == "cy";
  return pixels ? parameter + "_px" : parameter;
}

/// What a pose is called in the file.
struct PoseNames {
  std::string name;
  std::string parent;
  std::string child;
};

inline PoseNames cameraPoseNames(Mount mount, const std::string& camera, Stream stream) {
  const bool fixed = mount == Mount::kFixed;
  return {std::string(fixed ? "bM" : "eM") + (stream == Stream::kColor ? "c" : "i"),
          fixed ? "base" : "end_effector", camera + "_" + toString(stream)};
}
/// Of a joint estimate that does not say it (files before 2026-11-29): that of the hand-eye.
inline Mount mountOfHandEye(const CalibrationResult& result) {
  for (const CameraResult& camera : result.cameras) {
    if (camera.hand_eye) return camera.hand_eye->mount;
  }
  return Mount::kFixed;
}
inline PoseNames boardPoseNames(Mount mount) {
  if (mount == Mount::kFixed) return {"eMo", "end_effector", "board"};
  return {"bMo", "base", "board"};
}
inline PoseNames cameraPairNames(const std::string& first, const std::string& second) {
  return {"first_by_second", first + "_color", second + "_color"};
}
inline PoseNames colorInfraredNames(const std::string& camera) {
  return {"cMi", camera + "_color", camera + "_infrared"};
}

inline PoseNames jointPairNames(const JointPair& pair) {
  return {"first_by_second", pair.first + "_" + toString(pair.first_stream),
          pair.second + "_" + toString(pair.second_stream)};
}

inline bool sameModel(const CameraModel& a, const CameraModel& b) {
  return a.lens == b.lens && a.width_px == b.width_px && a.height_px == b.height_px &&
         a.parameters == b.parameters;
}

}  // namespace servocal::session
