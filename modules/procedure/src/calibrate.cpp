// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/procedure/calibrate.h"

#include <stdexcept>

#include "run.h"
#include "servocal/procedure/solve.h"

namespace servocal::procedure {

CalibrationResult calibrate(const CellConfig& cell, const Devices& devices, session::Session& session,
                            const EventSink& on_event) {
  if (devices.cameras.size() != cell.cameras.size() || cell.cameras.empty()) {
    throw std::invalid_argument("calibrate needs the cell's cameras, in order");
  }
  Run run(cell, devices, session, on_event);
  CalibrationResult result;
  result.board = cell.board;

  std::vector<TiltLimit> tilt_limits;
  double tilt_time_s = 0.0;
  std::optional<CoverResult> covered;
  if (const auto problem = bootstrap(run)) {
    result.missing.push_back(*problem);
  } else {
    const Instant tilt_begin = run.clock().now();
    tilt_limits = findTiltLimits(run);
    tilt_time_s = toSeconds(run.clock().now() - tilt_begin);
    covered = cover(run, tilt_limits);
    run.guard().stopAndWait();
    run.setEta(std::nullopt);
    run.report("solve", 0, 1, "Solving from " + std::to_string(run.observations().size()) + " observations.");
    SolveOptions options;
    options.robot_sigma_m = cell.arm.accuracy_m;
    options.robot_sigma_rad = cell.arm.accuracy_rad;
    result = solve(cell.board, run.observations(), options);
    result.missing.insert(result.missing.end(), covered->missing.begin(), covered->missing.end());
    if (!result.cameras.empty()) {
      result.cameras.front().coverage = covered->summary;
      result.cameras.front().tilt_limits = tilt_limits;
    }
  }
  result.goal_met = result.missing.empty();
  if (const auto span = run.guard().motionSpan()) result.motion_time_s = toSeconds(span->second - span->first);
  result.tilt_time_s = tilt_time_s;
  result.observations = static_cast<int>(run.observations().size());
  return result;
}

}  // namespace servocal::procedure
