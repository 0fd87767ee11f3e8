// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app_arm/start_pose.h"

#include <cmath>

#include "servocal/core/error.h"
#include "servocal/robot/path_planner.h"
#include "servocal/servo/follow_path.h"

namespace servocal::app {
namespace {

constexpr double kThereRad = M_PI / 180.0;
constexpr double kRoomM = 0.01;  // Beyond the guard's own clearance, as in robot::PlanOptions.
constexpr double kSpeedShare = 0.5;

}  // namespace

void goToStart(const CellConfig& cell, robot::Guard& guard, Clock& clock) {
  const Eigen::VectorXd q = guard.state().q;
  if ((q - cell.arm.start_q).cwiseAbs().maxCoeff() < kThereRad) return;
  const double room_m = guard.objection(q, kRoomM) ? 0.0 : kRoomM;
  const auto free = [&](const Eigen::VectorXd& at) { return !guard.objection(at, room_m); };
  const auto way = robot::planPath(guard.kinematics(), free, q, cell.arm.start_q);
  if (!way) {
    const auto here = guard.objection(q), there = guard.objection(cell.arm.start_q);
    throw Error(ErrorKind::kRefusedToMove,
                "There is no way from where the arm stands to the start pose (arm: "
                "start_q_deg). " +
                    (here    ? "Where it stands: " + *here + " "
                     : there ? "At the start pose: " + *there + " "
                             : std::string()) +
                    "Bring it near the start pose by hand, then start again.");
  }
  servo::FollowOptions options;
  options.speed_share = kSpeedShare;
  const servo::DriveOutcome outcome = servo::followPath(guard, clock, *way, options);
  if (outcome.status == DriveStatus::kReached) return;
  if (outcome.status == DriveStatus::kStopped) {
    throw Error(ErrorKind::kInterrupted,
                "Stopped by the operator on the way to the start pose. The arm stands still.");
  }
  throw Error(ErrorKind::kSafetyStop, "The arm did not get to the start pose. " + outcome.reason);
}

}  // namespace servocal::app
