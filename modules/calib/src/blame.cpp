// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/blame.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "joint_prediction.h"
#include "joint_step.h"
#include "servocal/calib/diagnose.h"
#include "view_reasons.h"

namespace servocal::calib {
namespace {

template <class... Arguments>
std::string text(const char* format, Arguments... arguments) {
  char out[300];
  std::snprintf(out, sizeof out, format, arguments...);
  return out;
}

/// A step too large for the gate: one side of it is left out. From which view on; nothing unless at least
/// four are out and nine of ten views lie on the right side.
std::optional<std::int64_t> leftOutSince(const JointCamera& camera) {
  constexpr int kLeastOut = 4;
  constexpr double kRightSide = 0.9;
  const int count = static_cast<int>(camera.views.size());
  const int out = static_cast<int>(std::count_if(camera.views.begin(), camera.views.end(),
                                                 [](const ViewResidual& view) { return !view.used; }));
  if (out < kLeastOut || count - out < kLeastOut) return std::nullopt;
  int best = 0, best_split = 0, used_before = 0;
  for (int split = 1; split < count; ++split) {
    used_before += camera.views[static_cast<std::size_t>(split) - 1].used ? 1 : 0;
    const int out_before = split - used_before;
    const int right_side = std::max(used_before + out - out_before, out_before + (count - out) - used_before);
    if (right_side <= best) continue;
    best = right_side;
    best_split = split;
  }
  if (best < kRightSide * count) return std::nullopt;
  return camera.views[static_cast<std::size_t>(best_split)].observation_id;
}

/// Cameras whose views are left out on one side; if it is all of them, it is the board.
std::vector<Fault> largeSteps(const JointSolution& solution) {
  std::vector<Fault> faults;
  for (const JointCamera& camera : solution.cameras) {
    const auto since = leftOutSince(camera);
    if (!since) continue;
    Fault fault;
    fault.kind = FaultKind::kCameraMoved;
    fault.camera = camera.camera;
    fault.since = since;
    fault.moved_m = fault.moved_rad = NAN;
    fault.significance = INFINITY;
    fault.sentence = "the camera " + camera.camera + " (" + toString(camera.stream) +
                     ") was moved, so far that its views on one side of observation " +
                     std::to_string(*since) + " had to be left out: fasten it and record again";
    faults.push_back(fault);
  }
  if (faults.size() < solution.cameras.size()) return faults;
  Fault board = faults.front();
  board.kind = FaultKind::kBoardMoved;
  board.camera.clear();
  board.sentence =
      "the board slipped on its mount (or the robot's base moved), so far that the views on one side of "
      "observation " +
      std::to_string(*board.since) + " had to be left out: fasten it and record again";
  return {board};
}

double typicalClaimPx(const std::vector<Observation>& observations, const JointCamera& camera) {
  std::vector<double> claims;
  for (const Observation& observation : observations) {
    for (const StreamObservation& seen : observation.views) {
      if (seen.camera != camera.camera || seen.stream != camera.stream) continue;
      const double sigma_px = claimedSigmaPx(seen.detection);
      if (sigma_px > 0) claims.push_back(sigma_px);
    }
  }
  if (claims.empty()) return 0.2;  // what a detector that claims nothing is taken to be worth
  std::nth_element(claims.begin(), claims.begin() + claims.size() / 2, claims.end());
  return claims[claims.size() / 2];
}

void judgeNoise(const std::vector<Observation>& observations, const JointSolution& solution, Blame& blame) {
  constexpr double kRatio = 2.0, kSigmas = 4.0;
  const auto significance = [](double ratio, double degrees) {
    return (ratio - 1.0) * std::sqrt(2.0 * degrees);
  };
  const RobotNoise& robot = solution.robot;
  const auto judge = [&](const char* part, const char* unit, double scale, double found, double stated,
                         double degrees) {
    blame.budgets.push_back({part, unit, scale * found, scale * stated});
    if (degrees <= 0 || found < kRatio * stated || significance(found / stated, degrees) < kSigmas) return;
    Fault fault;
    fault.kind = FaultKind::kRobotNoise;
    fault.significance = significance(found / stated, degrees);
    fault.sentence = text(
        "the %s errs by %.3g %s per axis, %.1f times what is declared: check the arm's calibration, "
        "its joints, and that board and cameras are fastened",
        part, scale * found, unit, found / stated);
    blame.faults.push_back(fault);
  };
  judge("robot position", "mm", 1e3, robot.sigma_m, robot.declared_m, robot.degrees_m);
  judge("robot orientation", "deg", 180 / M_PI, robot.sigma_rad, robot.declared_rad, robot.degrees_rad);
  for (const JointCamera& camera : solution.cameras) {
    const std::string name = camera.camera + " " + toString(camera.stream);
    const double stated_px = typicalClaimPx(observations, camera), ratio = std::sqrt(camera.chi_square);
    blame.budgets.push_back({"corners of " + name, "px", ratio * stated_px, stated_px});
    if (ratio < kRatio) continue;
    Fault fault;
    fault.kind = FaultKind::kCornerNoise;
    fault.camera = camera.camera;
    fault.significance = significance(ratio, 2.0 * static_cast<double>(camera.views.size()));
    fault.sentence = text(
        "the corners of %s scatter by %.2f px, %.1f times what the detector claims: blur, light, a "
        "lens that the model does not describe, or another board",
        name.c_str(), ratio * stated_px, ratio);
    blame.faults.push_back(fault);
  }
}

void judgeBoard(const BoardSpec& board, const JointSolution& solution, Blame& blame) {
  constexpr double kSigmas = 5.0, kLeastScale = 0.003, kLeastBowM = 3e-4;
  int at = solution.shape_at;
  if (solution.board_freedom.scale) {
    const double scale = 0.5 * (solution.board.scale_x + solution.board.scale_y);
    const double sigma = std::max(solution.sigma[at], solution.sigma[at + 1]);
    at += 2;
    blame.budgets.push_back({"board size", "%", 100 * (scale - 1), 100 * solution.board_freedom.scale_sigma});
    if (std::abs(scale - 1) > std::max(kLeastScale, kSigmas * sigma)) {
      Fault fault;
      fault.kind = FaultKind::kBoardSize;
      fault.significance = std::abs(scale - 1) / sigma;
      fault.sentence = sizeText(board, scale) + ": measure the board";
      blame.faults.push_back(fault);
    }
  }
  if (solution.board_freedom.bow) {
    const bool in_x = std::abs(solution.board.bow_x_m) > std::abs(solution.board.bow_y_m);
    const double bow_m = in_x ? solution.board.bow_x_m : solution.board.bow_y_m;
    const double sigma = solution.sigma[in_x ? at : at + 1];
    blame.budgets.push_back({"board bow", "mm", 1e3 * bow_m, 1e3 * solution.board_freedom.bow_sigma_m});
    if (std::abs(bow_m) > std::max(kLeastBowM, kSigmas * sigma)) {
      Fault fault;
      fault.kind = FaultKind::kBoardBowed;
      fault.significance = std::abs(bow_m) / sigma;
      fault.sentence = text(
          "the board is bowed by %.2f mm along its %s; the solution allows for it, a flat plate is "
          "better",
          1e3 * std::abs(bow_m), in_x ? "rows" : "columns");
      blame.faults.push_back(fault);
    }
  }
}

}  // namespace

Blame findFaults(const BoardSpec& board, const std::vector<Observation>& unsorted,
                 const JointSolution& solution) {
  std::vector<Observation> observations = unsorted;
  std::stable_sort(observations.begin(), observations.end(),
                   [](const Observation& a, const Observation& b) { return a.id < b.id; });
  Blame blame;
  judgeNoise(observations, solution, blame);
  judgeBoard(board, solution, blame);

  // A step bends noise and board alike; what they seem to do beside it means nothing.
  const std::vector<Fault> large = largeSteps(solution);
  if (!large.empty()) {
    blame.faults = large;
    return blame;
  }
  if (solution.covariance.allFinite()) {
    JointPrediction prediction(board, observations, solution);
    prediction.restore(solution);
    const JointProblem& problem = prediction.problem();
    // Six parameters at an unknown one of many moments: by chance once in a thousand runs below 45.
    constexpr double kBeyondChance = 45.0;
    const JointStep step = bestStep(problem, prediction.state(), solution);
    if (step.chi_square > kBeyondChance) {
      Fault fault;
      fault.significance = std::sqrt(step.chi_square);
      fault.since = problem.stops()[step.stop].observation->id;
      fault.moved_m = step.moved.head<3>().norm();
      fault.moved_rad = step.moved.tail<3>().norm();
      fault.kind = step.camera.empty() ? FaultKind::kBoardMoved : FaultKind::kCameraMoved;
      fault.camera = step.camera;
      const std::string what =
          step.camera.empty() ? "the board slipped on its mount" : "the camera " + step.camera + " was moved";
      fault.sentence = text(
          "%s by %.1f mm and %.2f degrees at or before observation %lld: fasten it and record again, "
          "or solve the two parts by themselves",
          what.c_str(), 1e3 * fault.moved_m, fault.moved_rad * 180 / M_PI,
          static_cast<long long>(*fault.since));
      blame.faults = {fault};
    }
  }
  std::stable_sort(blame.faults.begin(), blame.faults.end(),
                   [](const Fault& a, const Fault& b) { return a.significance > b.significance; });
  return blame;
}

}  // namespace servocal::calib
