// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/procedure/calibrate.h"

#include <algorithm>
#include <map>
#include <stdexcept>

#include "goals.h"
#include "known.h"
#include "log.h"
#include "resume.h"
#include "run.h"
#include "servocal/procedure/solve.h"
#include "servocal/procedure/summary.h"
#include "slip_check.h"

namespace servocal::procedure {
namespace {

/// The color eyes in the order of their turns: first one that sees the board where the arm stands now or, if none
/// does, that finds it in the search sweep. A sentence if that found none.
std::vector<Eye*> turns(Run& run, std::vector<std::string>& missing) {
  std::vector<Eye*> order;
  for (Eye& eye : run.eyes()) {
    if (eye.stream() == Stream::kColor) order.push_back(&eye);
  }
  auto first = std::find_if(order.begin(), order.end(), [&](Eye* eye) {
    const auto seen = eye->observer().see(run.clock().now() + std::chrono::milliseconds(500));
    return seen && seen->detection && eye->observer().isUsable(*seen->detection);
  });
  if (first == order.end() && run.cell().arm.search && !order.empty()) {
    run.report("find", *order.front(), 0, 0, "No camera sees the board; the arm looks round.");
    const Found found = search(run);
    if (!found.eye) missing.push_back(found.problem);
    first = std::find(order.begin(), order.end(), found.eye);
  }
  if (first != order.end()) std::rotate(order.begin(), first, first + 1);
  return order;
}

/// One camera's turn; a sentence if it could not begin.
std::optional<std::string> takeTurn(Run& run, Eye& color, double& tilt_time_s) {
  if (const auto problem = run.eMo() ? handOver(run, color) : bootstrap(run, color)) return problem;
  Eye* const infrared = run.find(color.camera(), Stream::kInfrared);
  if (!run.options().hand_eye_only) {
    const Instant tilt_begin = run.clock().now();
    findTiltLimits(run, color);
    tilt_time_s += toSeconds(run.clock().now() - tilt_begin);
    if (run.cell().planner.choose_by == Planner::kInformation) return std::nullopt;  // All cameras together, later.
    int budget = run.cell().coverage.max_views - viewsTaken(run, "cover", color.camera());
    budget -= cover(run, color, budget);
    if (infrared) run.updateBelief(*infrared);
    if (infrared && infrared->bMc()) cover(run, *infrared, budget);
  }
  revisit(run, color);
  takeCheckViews(run, color);
  return std::nullopt;
}

/// What became of an eye's frames and stamps.
void addTiming(Eye& eye, CameraResult& camera, std::vector<std::string>& missing) {
  if (eye.stream() == Stream::kColor && eye.timeOffset()) {
    camera.time_offset_s = eye.timeOffset()->offset_s;
    camera.time_offset_sigma_s = eye.timeOffset()->sigma_s;
  }
  if (const auto late = eye.tooLate()) missing.push_back(eye.name() + ": " + *late);
  const sensor::FrameCounts counts = eye.device().counts(eye.stream());
  if (counts.dropped() > 0) camera.notes.push_back(std::string(toString(eye.stream())) + " frames dropped: " + counts.text());
  if (const auto slow = eye.device().slowness(eye.stream()))
    camera.notes.push_back(std::string(toString(eye.stream())) + ": " + *slow);
}

void addCoverage(const std::string& camera, Eye& eye, std::optional<CoverageSummary>& summary, bool wanted,
                 std::vector<std::string>& missing) {
  summary = eye.coverage.summary();
  if (!wanted) return;
  for (const std::string& sentence : eye.coverage.missing()) {
    missing.push_back(camera + " " + toString(eye.stream()) + ": " + sentence);
  }
}

}  // namespace

SolveOptions solveOptions(const Run& run) {
  SolveOptions options;
  options.mount = run.mount();
  options.robot_sigma_m = run.cell().arm.accuracy_m;
  options.robot_sigma_rad = run.cell().arm.accuracy_rad;
  options.given_intrinsics = run.options().given_intrinsics;
  options.depth_sensors = depthSensors(run.cell());
  options.arm = run.cell().arm;
  options.workspace = run.cell().limits.workspace;
  return options;
}

namespace {

CalibrationResult calibrate(Run& run, session::Session& session) {
  const CellConfig& cell = run.cell();
  const CalibrateOptions& options = run.options();
  const std::set<std::string> over = takeOver(run, session);
  if (options.known) believeKnown(run, *options.known);
  std::vector<std::string> missing;
  double tilt_time_s = 0.0;
  const std::vector<Eye*> order = turns(run, missing);
  // Where the mount is known, one view tells where the first camera stands.
  if (run.eMo() && !order.empty() && !order.front()->bMc()) run.observe("find", *order.front());
  std::vector<Eye*> done;
  for (Eye* eye : order) {
    if (over.count(eye->camera()) > 0) {
      done.push_back(eye);
      continue;
    }
    if (const auto problem = takeTurn(run, *eye, tilt_time_s)) {
      missing.push_back(eye->camera() + ": " + *problem);
      run.report("find", *eye, 0, 0, *problem);
      if (!run.eMo()) break;  // Nobody knows yet where the board sits; the others cannot do without.
    } else {
      done.push_back(eye);
      noteTurnOver(run, *eye);
    }
  }
  const bool by_information = cell.planner.choose_by == Planner::kInformation && !options.hand_eye_only && !done.empty();
  std::optional<std::string> ended;
  if (by_information) {
    ended = inform(run);
    for (Eye* eye : done) takeCheckViews(run, *eye);
  }
  run.guard().stopAndWait();

  CalibrationResult result;
  result.board = cell.board;
  if (!done.empty()) {
    run.setEta(std::nullopt);
    run.report("solve", *done.front(), 0, 1, "Solving from " + std::to_string(run.observations().size()) + " observations.");
    result = solve(cell.board, run.observations(), solveOptions(run));
    if (const auto changed = options.known ? mountChanged(*options.known, result) : std::nullopt) {
      run.report("solve", *done.front(), 1, 1, *changed);
    }
  }
  result.missing.insert(result.missing.begin(), missing.begin(), missing.end());
  if (by_information && result.joint) {
    for (const std::string& sentence : goalsMissed(*result.joint, cell.planner)) {
      result.missing.push_back(ended ? sentence + "; " + *ended : sentence);
    }
  }
  if (by_information && !result.joint) {
    result.missing.push_back("there is no joint estimate to judge the goals by. " + result.joint_problem);
  }
  if (auto slip = slipDuring(run.observations(), result)) result.missing.push_back(*std::move(slip));
  for (CameraResult& camera : result.cameras) {
    Eye& color = *run.find(camera.camera, Stream::kColor);
    const bool had_turn = std::find(done.begin(), done.end(), &color) != done.end() && !options.hand_eye_only;
    addCoverage(camera.camera, color, camera.coverage, had_turn, result.missing);
    camera.tilt_limits = color.tilt_limits;
    addTiming(color, camera, result.missing);
    if (Eye* infrared = run.find(camera.camera, Stream::kInfrared)) {
      addCoverage(camera.camera, *infrared, camera.infrared_coverage, had_turn, result.missing);
      camera.tilt_limits.insert(camera.tilt_limits.end(), infrared->tilt_limits.begin(), infrared->tilt_limits.end());
      if (had_turn && infrared->views == 0) {
        result.missing.push_back(camera.camera + " infrared: the board was never found, while color saw it. Ink-jet "
                                 "black is transparent to infrared: print the board on a laser printer; or block a "
                                 "projector that dots it");
      }
      addTiming(*infrared, camera, result.missing);
      if (const auto trouble = infrared->depthTrouble()) {
        result.missing.push_back("depth of " + camera.camera + ": " + *trouble);
      }
    }
  }
  result.goal_met = result.missing.empty();
  if (const auto span = run.guard().motionSpan()) result.motion_time_s = toSeconds(span->second - span->first);
  result.tilt_time_s = tilt_time_s;
  result.observations = static_cast<int>(run.observations().size());
  return result;
}

}  // namespace

CalibrationResult calibrate(const CellConfig& cell, const Devices& devices, session::Session& session,
                            const EventSink& on_event, const CalibrateOptions& options,
                            const LookSink& on_look) {
  if (devices.cameras.size() != cell.cameras.size() || cell.cameras.empty()) {
    throw std::invalid_argument("calibrate needs the cell's cameras, in order");
  }
  Run run(cell, devices, session, on_event, options, on_look);
  noteBegin(run, session);
  try {
    CalibrationResult result = calibrate(run, session);
    run.log(kEnd, verdict(result));
    return result;
  } catch (const std::exception& error) {
    noteBrokenOff(run, error);
    throw;
  }
}

}  // namespace servocal::procedure
