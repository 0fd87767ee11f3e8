// SPDX-License-Identifier: GPL-3.0-or-later
// Color, infrared and depth together: what a depth pixel is worth in the color image.
#include <algorithm>
#include <map>

#include "evidence.h"
#include "servocal/core/cell_config.h"

namespace servocal::report {
namespace {

struct Nominal {
  CameraModel color, infrared;
};

/// What the data sheets say; nothing without a cell file that knows the camera.
std::optional<Nominal> nominalOf(const ReportInput& input, const std::string& name) {
  if (input.cell_text.empty()) return std::nullopt;
  for (const CameraConfig& camera : parseCell(input.cell_text, "cell file").cameras) {
    if (camera.name == name && camera.infrared)
      return Nominal{nominalModel(camera, Stream::kColor), nominalModel(camera, Stream::kInfrared)};
  }
  return std::nullopt;
}

std::map<int, Eigen::Vector2d> cornersOf(const Observation& observation, const std::string& camera,
                                         Stream stream) {
  std::map<int, Eigen::Vector2d> corners;
  for (const StreamObservation& view : observation.views) {
    if (view.camera != camera || view.stream != stream) continue;
    for (const Corner& corner : view.detection.corners) corners[corner.id] = corner.pixel;
  }
  return corners;
}

}  // namespace

std::vector<OverlayCorner> overlayCorners(const ReportInput& input, const CameraResult& camera) {
  std::vector<OverlayCorner> overlay;
  if (!camera.depth || !camera.infrared || !camera.color_infrared) return overlay;
  const std::optional<Nominal> nominal = nominalOf(input, camera.camera);
  for (const Observation& observation : input.observations) {
    const auto color = cornersOf(observation, camera.camera, Stream::kColor);
    const auto infrared = cornersOf(observation, camera.camera, Stream::kInfrared);
    for (const StreamObservation& view : observation.views) {
      if (view.camera != camera.camera || view.stream != Stream::kInfrared || !view.depth) continue;
      for (const CornerDepth& measured : view.depth->corners) {
        const auto seen = color.find(measured.id), from = infrared.find(measured.id);
        if (seen == color.end() || from == infrared.end()) continue;
        OverlayCorner corner;
        corner.view = observation.id;
        corner.color = seen->second;
        if (nominal) {
          if (const auto ray = nominal->infrared.unproject(from->second))
            corner.before = nominal->color.project(measured.depth_m * ray->homogeneous());
        }
        const auto ray = camera.infrared->camera.unproject(from->second);
        const auto depth_m = camera.depth->model.correct(from->second, measured.depth_m);
        if (ray && depth_m) {
          corner.after = camera.intrinsics.camera.project(camera.color_infrared->first_by_second *
                                                          Eigen::Vector3d(*depth_m * ray->homogeneous()));
        }
        overlay.push_back(corner);
      }
    }
  }
  return overlay;
}

}  // namespace servocal::report
