// SPDX-License-Identifier: GPL-3.0-or-later
#include "eye.h"

#include <algorithm>
#include <stdexcept>

namespace servocal::procedure {
namespace {

// Where the belief is rough, a board predicted this far outside the image may still be inside.
constexpr double kRoughPx = 60.0;
constexpr double kEdgeOn = 0.15;  // cosine of the angle to the line of sight
constexpr double kSureOfHeight = 0.015, kSureCosine = 0.5;

coverage::Coverage emptyCoverage(const CellConfig& cell, const CameraConfig& camera, Stream stream) {
  CoverageConfig config = cell.coverage;
  if (stream == Stream::kColor) return {config, camera.width_px, camera.height_px};
  config.cells_x = config.infrared_cells_x;
  config.cells_y = config.infrared_cells_y;
  return {config, camera.infrared->width_px, camera.infrared->height_px};
}

}  // namespace

Eye::Eye(const CellConfig& cell, const CameraConfig& camera, sensor::RgbdCamera& device, Stream stream)
    : coverage(emptyCoverage(cell, camera, stream)), camera_(camera), board_(cell.board), device_(device),
      stream_(stream), observer_(cell.board, device, stream, nominalModel(camera, stream)) {}

double Eye::rateHz() const {
  for (const sensor::StreamMode& mode : device_.info().streams) {
    if (mode.stream == stream_) return mode.rate_hz;
  }
  throw std::invalid_argument("camera '" + camera_.name + "' does not deliver " + toString(stream_));
}

void Eye::believe(HandEyeSolution solution) {
  bMc_ = Pose<Base, Color>(solution.camera_pose);
  hand_eye_ = std::move(solution);
}

std::optional<Pose<Color, Board>> Eye::predict(const Pose<Base, EndEffector>& bMe,
                                               const std::optional<Pose<EndEffector, Board>>& eMo) const {
  if (!bMc_ || !eMo) return std::nullopt;
  return bMc_->inverse() * bMe * *eMo;
}

bool Eye::mightSee(const Pose<Base, EndEffector>& bMe,
                   const std::optional<Pose<EndEffector, Board>>& eMo) const {
  const auto cMo = predict(bMe, eMo);
  return !cMo || isShown(*cMo, -kRoughPx, kEdgeOn);
}

bool Eye::shouldSee(const Pose<Base, EndEffector>& bMe,
                    const std::optional<Pose<EndEffector, Board>>& eMo) const {
  const auto cMo = predict(bMe, eMo);
  return cMo && isShown(*cMo, kSureOfHeight * model().height_px, kSureCosine);
}

bool Eye::isShown(const Pose<Color, Board>& cMo, double margin_px, double least_cosine) const {
  if (cMo.rotation().col(2).dot(cMo.translation().normalized()) < least_cosine) return false;
  const auto outline = board_.patternOutline();
  return std::all_of(outline.begin(), outline.end(), [&](const Eigen::Vector3d& point) {
    const auto pixel = model().project(cMo * point);
    return pixel && model().contains(*pixel, margin_px);
  });
}

void Eye::count(const StreamObservation& view) {
  ++views;
  std::vector<Eigen::Vector2d> pixels;
  for (const Corner& corner : view.detection.corners) pixels.push_back(corner.pixel);
  if (const auto cMo = observer_.poseOf(view.detection, view.stamp)) coverage.add(pixels, *cMo);
}

void Eye::note(const RobotState& robot, const BoardDetection& detection) {
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const Corner& corner : detection.corners) middle += corner.pixel;
  middle /= static_cast<double>(detection.corners.size());
  const Eigen::Vector2d centre(0.5 * (model().width_px - 1), 0.5 * (model().height_px - 1));
  const double from_centre_px = (middle - centre).norm();
  if (!sighting || from_centre_px < sighting->from_centre_px) sighting = Sighting{robot, from_centre_px};
}

void Eye::noteDepth(const std::string& reason) {
  ++depths_;
  if (reason.empty()) return;
  ++depth_failures_;
  depth_reason_ = reason;
}

std::optional<std::string> Eye::depthTrouble() const {
  if (2 * depth_failures_ <= depths_) return std::nullopt;
  return depth_reason_;
}

}  // namespace servocal::procedure
