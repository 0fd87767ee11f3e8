// SPDX-License-Identifier: GPL-3.0-or-later
// What a run shows to somebody who watches. Reads only: nothing here changes what the run does.
#include <algorithm>
#include <cmath>
#include <limits>

#include "run.h"

namespace servocal::procedure {
namespace {

constexpr Duration kLookPeriod = std::chrono::milliseconds(100);

std::vector<Eigen::Vector2d> outlineIn(const CameraModel& camera, const Pose<Color, Board>& cMo,
                                       const BoardSpec& board) {
  std::vector<Eigen::Vector2d> pixels;
  for (const Eigen::Vector3d& point_o : board.patternOutline()) {
    const auto pixel = camera.project(cMo * point_o);
    if (!pixel) return {};
    pixels.push_back(*pixel);
  }
  return pixels;
}

/// RMS distance of the corners to where they would be on a board at that pose.
std::optional<double> distancePx(const BoardDetection& detection, const CameraModel& camera,
                                 const Pose<Color, Board>& cMo, const BoardSpec& board) {
  double squares_px2 = 0.0;
  for (const Corner& corner : detection.corners) {
    const auto pixel = camera.project(cMo * board.corner(corner.id));
    if (!pixel) return std::nullopt;
    squares_px2 += (corner.pixel - *pixel).squaredNorm();
  }
  if (detection.corners.empty()) return std::nullopt;
  return std::sqrt(squares_px2 / static_cast<double>(detection.corners.size()));
}

GuardLook lookAt(const robot::Guard& guard, Instant now) {
  const robot::GuardRecord& record = guard.record();
  GuardLook look;
  if (record.at && now - *record.at < guard.options().command_timeout) {
    look.wanted = record.newest.wanted;
    look.applied = record.newest.applied;
    look.rule = toString(record.newest.rule);
    look.reason = record.newest.reason;
    look.refused = record.newest.refused();
  }
  for (const auto& [rule, count] : record.interventions) look.interventions[toString(rule)] = count;
  if (record.refused_at) {
    look.refused_at = record.refused_at;
    look.refused_reason = record.refused.reason;
  }
  return look;
}

ArmLook lookAt(robot::Guard& guard, const RobotState& state) {
  ArmLook arm;
  arm.stamp = state.stamp;
  arm.twist = state.twist;
  arm.max_frame_age = guard.options().max_frame_age;
  arm.operator_stopped = guard.operatorStopped();
  arm.joint_room_rad = std::min((state.q - guard.kinematics().lower()).minCoeff(),
                                (guard.kinematics().upper() - state.q).minCoeff());
  const Box& workspace = guard.limits().workspace;
  const Eigen::Vector3d flange = state.bMe.translation();
  arm.workspace_room_m =
      std::min((flange - workspace.min_m).minCoeff(), (workspace.max_m - flange).minCoeff());
  return arm;
}

}  // namespace

void Run::show(Eye& eye, const SeenFrame& seen) {
  const Instant now = clock().now();
  if (now < eye.last_shown + kLookPeriod) return;
  eye.last_shown = now;
  Look look;
  look.camera = eye.camera();
  look.frame = seen.frame;
  const auto expected = eye.predict(guard().stateAt(seen.frame.stamp).bMe, eMo_);
  if (expected) look.expected = outlineIn(eye.model(), *expected, cell_.board);
  const bool wanted = goal_ && goal_->eye == &eye;
  if (wanted) look.goal = outlineIn(eye.model(), goal_->cdMo, cell_.board);
  if (seen.detection) {
    for (const Corner& corner : seen.detection->corners) look.corners.push_back(corner.pixel);
    if (wanted) look.error_px = distancePx(*seen.detection, eye.model(), goal_->cdMo, cell_.board);
    if (expected) look.surprise_px = distancePx(*seen.detection, eye.model(), *expected, cell_.board);
  }
  look.arm = lookAt(guard(), guard().state());
  look.arm.guard = lookAt(guard(), now);
  on_look_(look);
}

std::vector<EyeProgress> Run::progress() const {
  std::vector<EyeProgress> all;
  for (const Eye& eye : eyes_) {
    EyeProgress progress;
    progress.camera = eye.camera();
    progress.stream = eye.stream();
    progress.views = eye.views;
    progress.found = eye.bMc().has_value();
    if (const auto& hand_eye = eye.handEye()) {
      progress.sigma_m = hand_eye->camera_sigma.head<3>().norm();
      progress.sigma_rad = hand_eye->camera_sigma.tail<3>().norm();
      progress.rms_px = hand_eye->rms_px;
    }
    progress.coverage = eye.coverage.summary();
    progress.tilt_limits = eye.tilt_limits;
    all.push_back(std::move(progress));
  }
  return all;
}

}  // namespace servocal::procedure
