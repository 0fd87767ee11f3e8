// SPDX-License-Identifier: GPL-3.0-or-later
#include "eye.h"

#include <algorithm>
#include <cstdio>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "servocal/core/mount.h"
#include "servocal/servo/drive.h"

namespace servocal::procedure {
namespace {

// Where the belief is rough, a board predicted this far outside the image may still be inside.
constexpr double kRoughPx = 60.0;
constexpr double kEdgeOn = 0.15;  // cosine of the angle to the line of sight
constexpr std::size_t kSightsToCompare = 60;  // two seconds of motion
constexpr double kClocksAgreeS = 0.006;
constexpr double kClockSearchS = 0.15;
constexpr int kFloorCellsX = 4, kFloorCellsY = 3, kFloorCorners = 6, kFloorViews = 2;
constexpr double kSureOfHeight = 0.015, kSureCosine = 0.5;

/// What of an eye's image is to be covered. The color image's region, seen from afar by infrared.
ImageRegion regionOf(const CameraConfig& camera, Stream stream) {
  if (stream == Stream::kColor) return camera.region.value_or(ImageRegion{0, 0, camera.width_px, camera.height_px});
  const ImageRegion whole{0, 0, camera.infrared->width_px, camera.infrared->height_px};
  if (!camera.region) return whole;
  const CameraModel color = nominalModel(camera, Stream::kColor), infrared = nominalModel(camera, stream);
  const auto seen = [&](int x_px, int y_px) {
    const Eigen::Vector2d pixel = *infrared.project(color.unproject(Eigen::Vector2d(x_px, y_px))->homogeneous());
    return Eigen::Vector2i(std::clamp(static_cast<int>(pixel.x()), 0, whole.width_px),
                           std::clamp(static_cast<int>(pixel.y()), 0, whole.height_px));
  };
  const ImageRegion& region = *camera.region;
  const Eigen::Vector2i from = seen(region.x_px, region.y_px);
  const Eigen::Vector2i to = seen(region.x_px + region.width_px, region.y_px + region.height_px);
  if (to.x() <= from.x() || to.y() <= from.y()) return whole;
  return {from.x(), from.y(), to.x() - from.x(), to.y() - from.y()};
}

coverage::Coverage emptyCoverage(const CellConfig& cell, const CameraConfig& camera, Stream stream) {
  CoverageConfig config = cell.coverage;
  if (cell.planner.choose_by == Planner::kInformation) {
    // A floor: what information says is worth no view may be wrong about the lens.
    config.cells_x = kFloorCellsX;
    config.cells_y = kFloorCellsY;
    config.corners_per_cell = kFloorCorners;
    return {config, regionOf(camera, stream), {kFloorViews, kFloorViews, 1}};
  }
  if (stream == Stream::kInfrared) {
    config.cells_x = config.infrared_cells_x;
    config.cells_y = config.infrared_cells_y;
  }
  return {config, regionOf(camera, stream)};
}

}  // namespace

Eye::Eye(const CellConfig& cell, const CameraConfig& camera, sensor::GatedCamera& device, Stream stream)
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
  return bMc_->inverse() * forMount(camera_.mount, bMe) * *eMo;
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

void Eye::noteMotion(const calib::TimedBoard& sight) {
  if (!time_offset_) in_motion_.push_back(sight);
}

void Eye::compareClocks(const std::vector<RobotState>& path, const Pose<EndEffector, Board>& eMo) {
  if (time_offset_ || in_motion_.size() < kSightsToCompare) return;
  calib::TimeOffsetOptions options;
  options.search_s = kClockSearchS;
  const calib::TimeOffset offset = calib::estimateTimeOffset(in_motion_, path, eMo, options);
  in_motion_.clear();
  // No image arrives before it is exposed.
  const bool is_possible = offset.status == calib::TimeOffsetStatus::kSolved && camera_.latency_s + offset.offset_s > 0.0;
  if (!is_possible) return;
  // A wrong one would make the eye blind or its frames stale: two answers from different drives must agree.
  const std::optional<calib::TimeOffset> before = std::exchange(first_offset_, offset);
  if (!before || std::abs(before->offset_s - offset.offset_s) > kClocksAgreeS) return;
  time_offset_ = offset;
  time_offset_->offset_s = 0.5 * (before->offset_s + offset.offset_s);
  device_.setOffset(stream_, time_offset_->offset_s);
  if (hasDepth()) device_.setOffset(Stream::kDepth, time_offset_->offset_s);
}

std::optional<std::string> Eye::tooLate() const {
  if (!time_offset_) return std::nullopt;
  const double age_s = camera_.latency_s + time_offset_->offset_s, oldest_s = age_s + 1.0 / rateHz();
  const double limit_s = toSeconds(servo::DriveOptions{}.lost_stop);
  if (oldest_s < limit_s) return std::nullopt;
  char text[240];
  std::snprintf(text, sizeof text,
                "its images are %.0f ms old when they come, where the data sheet says %.0f (latency_s in the cell "
                "file): too late for a servo, which needs them within %.0f ms",
                1e3 * age_s, 1e3 * camera_.latency_s, 1e3 * (limit_s - 1.0 / rateHz()));
  return text;
}

std::string Eye::whyBlind() const {
  if (const auto light = observer_.lightTrouble()) return " (" + *light + ")";
  const sensor::FrameCounts counts = device_.counts(stream_);
  if (counts.accepted == 0 && counts.dropped() == 0) return " (no image came from it)";
  if (counts.dropped() > counts.accepted)
    return " (most of its images were of no use: " + counts.text() + ")";
  if (const auto slow = device_.slowness(stream_)) return " (" + *slow + ")";
  return "";
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
