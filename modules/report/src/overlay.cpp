// SPDX-License-Identifier: GPL-3.0-or-later
// Color, infrared and depth together: what a depth pixel is worth in the color image.
#include <algorithm>
#include <map>

#include "evidence.h"
#include "overlay_picture.h"
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

std::optional<OverlayPictures> overlayPictures(const ReportInput& input, const CameraResult& camera,
                                               std::int64_t view) {
  const std::optional<Nominal> nominal = nominalOf(input, camera.camera);
  if (!camera.depth || !camera.infrared || !camera.color_infrared || !nominal || input.folder.empty())
    return std::nullopt;
  OverlayImages images;
  for (const Observation& observation : input.observations) {
    if (observation.id != view) continue;
    for (const StreamObservation& seen : observation.views) {
      if (seen.camera != camera.camera) continue;
      if (seen.stream == Stream::kColor) {
        images.color = readGray(input.folder, seen.image_file);
        for (const Corner& corner : seen.detection.corners) {
          const auto at = cv::Point(static_cast<int>(corner.pixel.x()), static_cast<int>(corner.pixel.y()));
          const cv::Rect one(at, cv::Size(1, 1));
          images.board = images.board.empty() ? one : images.board | one;
        }
      }
      if (seen.stream != Stream::kInfrared || !seen.depth) continue;
      images.infrared = readGray(input.folder, seen.image_file);
      images.depth = readCounts(input.folder, seen.depth->image_file);
    }
  }
  DepthModel as_delivered;
  as_delivered.sensor = camera.depth->model.sensor;
  as_delivered.camera = nominal->infrared;
  const Registration before{nominal->color, as_delivered, Pose<Color, Infrared>::identity()};
  const Registration after{camera.intrinsics.camera, camera.depth->model,
                           Pose<Color, Infrared>(camera.color_infrared->first_by_second)};
  if (!fits(images, before) || !fits(images, after)) return std::nullopt;
  return OverlayPictures{jpegDataUrl(drawOverlay(images, before)), jpegDataUrl(drawOverlay(images, after))};
}

}  // namespace servocal::report
