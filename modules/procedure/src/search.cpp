// SPDX-License-Identifier: GPL-3.0-or-later
// Where are the cameras? The raised arm turns its first joint and shows the board around.
#include <algorithm>

#include "run.h"
#include "servocal/robot/path_planner.h"
#include "servocal/servo/follow_path.h"

namespace servocal::procedure {
namespace {

// Slow enough for exposures of 20 ms, and for three looks per second.
constexpr double kSweepRadps = 0.15;

std::optional<std::string> follow(Run& run, const std::vector<Eigen::VectorXd>& path,
                                  const servo::FollowOptions& options = {}) {
  const servo::DriveOutcome outcome = servo::followPath(run.guard(), run.clock(), path, options);
  run.throwIfStopped();  // Not "no camera was found".
  if (outcome.status != DriveStatus::kReached) return outcome.reason;
  return std::nullopt;
}

}  // namespace

Found search(Run& run) {
  const SearchSweep& sweep = *run.cell().arm.search;
  Eigen::VectorXd begin = sweep.posture_q, end = sweep.posture_q;
  begin[0] = sweep.from_rad;
  end[0] = sweep.to_rad;
  const auto free = [&](const Eigen::VectorXd& q) { return run.guard().allows(q); };
  const auto way = robot::planPath(run.guard().kinematics(), free, run.guard().state().q, begin);
  if (!way) return {nullptr, "there is no way to the posture in which the arm looks for cameras (arm: search)"};
  if (auto blocked = follow(run, *way)) return {nullptr, *blocked};

  servo::FollowOptions options;
  options.max_joint_speed_radps = kSweepRadps;
  options.watch = [&]() -> std::optional<std::string> {
    run.lookOn();
    return std::nullopt;
  };
  if (auto blocked = follow(run, {begin, end}, options)) return {nullptr, *blocked};

  for (Eye& eye : run.eyes()) {
    if (!eye.sighting) continue;
    // Back along the same way, where nothing was touched.
    if (auto blocked = follow(run, {run.guard().state().q, eye.sighting->robot.q})) return {nullptr, *blocked};
    return {&eye, ""};
  }
  return {nullptr, "no camera saw the board while the arm looked round"};
}

}  // namespace servocal::procedure
