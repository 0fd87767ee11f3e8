// SPDX-License-Identifier: GPL-3.0-or-later
// First eye-to-hand estimate from probing motions; nothing is known but the nominal field of view.
#include <algorithm>
#include <cmath>

#include "run.h"

namespace servocal::procedure {
namespace {

constexpr double kProbeM = 0.04;
constexpr double kProbeRad = 0.2;
constexpr double kFirstFraction = 0.25;  // of a probe, to see how far the full one would go in the image
constexpr double kKeepMarginPx = 60.0;

/// Smallest distance of a corner to the image border, px.
double marginPx(const BoardDetection& detection, const CameraModel& camera) {
  double margin = camera.width_px;
  for (const Corner& corner : detection.corners) {
    margin = std::min({margin, corner.pixel.x(), corner.pixel.y(), camera.width_px - 1 - corner.pixel.x(),
                       camera.height_px - 1 - corner.pixel.y()});
  }
  return margin;
}

double largestMotionPx(const BoardDetection& from, const BoardDetection& to) {
  double motion = 0.0;
  auto before = from.corners.begin();
  for (const Corner& after : to.corners) {
    while (before != from.corners.end() && before->id < after.id) ++before;
    if (before == from.corners.end()) break;
    if (before->id == after.id) motion = std::max(motion, (before->pixel - after.pixel).norm());
  }
  return motion;
}

/// The board as it is seen with the arm at rest, within a second.
std::optional<BoardDetection> seeBoard(Run& run, Eye& eye) {
  const Instant rest = run.clock().now();
  const Instant deadline = rest + std::chrono::seconds(1);
  while (run.clock().now() < deadline) {
    const auto seen = eye.observer().see(deadline);
    if (!seen) return std::nullopt;
    if (seen->frame.stamp > rest && seen->detection && eye.observer().isUsable(*seen->detection)) {
      return seen->detection;
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> bootstrap(Run& run, Eye& eye) {
  struct Probe {
    Eigen::Vector3d translation_b, rotation_e;
  };
  using Eigen::Vector3d;
  const Vector3d none = Vector3d::Zero();
  const std::vector<Probe> probes = {
      {none, kProbeRad * Vector3d::UnitX()},  {none, kProbeRad * Vector3d::UnitY()},
      {none, kProbeRad * Vector3d::UnitZ()},  {kProbeM * Vector3d::UnitX(), none},
      {kProbeM * Vector3d::UnitY(), none},    {kProbeM * Vector3d::UnitZ(), none},
      {none, -kProbeRad * Vector3d::UnitX()}, {none, -kProbeRad * Vector3d::UnitY()},
  };
  const int planned = 1 + static_cast<int>(probes.size());

  const auto start_seen = seeBoard(run, eye);
  if (!start_seen || !run.observe("bootstrap", eye)) {
    return "The camera does not see the board at the start pose" + eye.whyBlind() +
           ". Put the board into its view (arm: start_q_deg in the cell file), facing it, or let the arm look for "
           "the cameras (arm: search), and start again.";
  }
  run.report("bootstrap", eye, 1, planned, "The camera sees the board.");

  const Pose<Base, EndEffector> bMe_start = run.guard().state().bMe;
  const auto moved = [&](const Probe& probe, double fraction) {
    const auto turn = Pose<EndEffector, EndEffector>::fromRotationVector(fraction * probe.rotation_e, none);
    return Pose<Base, EndEffector>(Eigen::Matrix3d((bMe_start * turn).rotation()),
                                   bMe_start.translation() + fraction * probe.translation_b);
  };
  const double margin_px = marginPx(*start_seen, eye.model());
  int done = 1;
  std::string blocked;  // A probe that the arm cannot make is left out; the others may do.
  for (const Probe& probe : probes) {
    // A first small step shows how the board moves in the image, which nothing else could tell yet.
    if (const auto reason = run.moveTo(moved(probe, kFirstFraction))) {
      blocked = " " + *reason;
      continue;
    }
    if (const auto seen = seeBoard(run, eye)) {
      const double full_motion_px = largestMotionPx(*start_seen, *seen) / kFirstFraction;
      const double fraction = std::min(1.0, (margin_px - kKeepMarginPx) / std::max(full_motion_px, 1.0));
      if (fraction > kFirstFraction) {
        if (const auto reason = run.moveTo(moved(probe, fraction))) blocked = " " + *reason;
      }
      if (run.observe("bootstrap", eye)) ++done;
    }
    run.report("bootstrap", eye, done, planned);
  }
  if (const auto reason = run.moveTo(bMe_start)) return reason;
  if (run.observe("bootstrap", eye)) ++done;
  if (const auto why = run.updateBelief(eye)) {
    return "The probing motions do not determine where the camera stands: " + *why + blocked;
  }
  run.report("bootstrap", eye, done, planned, "First eye-to-hand estimate.");
  return std::nullopt;
}

}  // namespace servocal::procedure
