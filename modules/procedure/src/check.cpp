// SPDX-License-Identifier: GPL-3.0-or-later
// Drives to a handful of known-good views and asks whether the stored calibration still holds.
#include "servocal/procedure/check.h"

#include <algorithm>

#include "run.h"
#include "servocal/core/error.h"

namespace servocal::procedure {
namespace {

/// Only what the check looks at: color of the cameras that the result knows.
CellConfig colorOnly(const CellConfig& cell) {
  CellConfig color = cell;
  for (CameraConfig& camera : color.cameras) camera.infrared.reset();
  return color;
}

/// Views taken; each camera's neighbors look at the same time.
int takeViews(Run& run, Eye& eye, int wanted) {
  int taken = 0;
  for (const Pose<Color, Board>& cMo : checkViews(eye.model(), run.cell().coverage.near_distance_m)) {
    if (taken == wanted) break;
    if (run.travelTo(run.flangeFor(eye, cMo))) continue;
    if (run.observe(kCheckStage, eye)) ++taken;
    run.report(kCheckStage, eye, taken, wanted);
  }
  return taken;
}

}  // namespace

CheckVerdict check(const CellConfig& full_cell, const Devices& devices, const CalibrationResult& stored,
                   session::Session& session, const EventSink& on_event) {
  const CellConfig cell = colorOnly(full_cell);
  CalibrateOptions options;
  options.given_intrinsics = intrinsicsOf(stored);
  for (const CameraResult& camera : stored.cameras) {
    const bool in_cell = std::any_of(cell.cameras.begin(), cell.cameras.end(),
                                     [&](const CameraConfig& other) { return other.name == camera.camera; });
    if (in_cell && camera.hand_eye && camera.hand_eye->mount == Mount::kFixed)
      options.cameras.push_back(camera.camera);
  }
  if (options.cameras.empty()) {
    throw Error(ErrorKind::kInvalidConfig, "the result says of no camera of this cell where it stands");
  }
  const LookSink nobody_watches;
  Run run(cell, devices, session, on_event, options, nobody_watches);
  for (Eye& eye : run.eyes()) {
    for (const CameraResult& camera : stored.cameras) {
      if (camera.camera == eye.camera()) run.believe(eye, *camera.hand_eye);
    }
  }
  for (Eye& eye : run.eyes()) takeViews(run, eye, checkViewsOfEach(run.eyes().size()));
  run.guard().stopAndWait();
  CheckOptions check_options;
  check_options.robot_sigma_m = cell.arm.accuracy_m;
  check_options.robot_sigma_rad = cell.arm.accuracy_rad;
  CheckVerdict verdict = judgeCalibration(stored, run.observations(), check_options);
  session.event(run.clock().now(), kCheckStage, verdict.sentence);
  return verdict;
}

}  // namespace servocal::procedure
