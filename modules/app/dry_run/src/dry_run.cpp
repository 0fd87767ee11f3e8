// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app_dry_run/dry_run.h"

#include <cmath>
#include <utility>

#include "planned_views.h"
#include "servocal/core/mount.h"
#include "still_arm.h"

namespace servocal::app {
namespace {

// As the run's own: its probing motions, its sweep, and what it keeps clear around cameras and a standing
// board.
constexpr double kProbeM = 0.04;
constexpr double kProbeRad = 0.2;
constexpr double kSweepRadps = 0.15;
constexpr double kCameraRadiusM = 0.2;
constexpr double kBoardRadiusM = 0.13;

const CameraResult* resultOf(const std::optional<CalibrationResult>& known, const std::string& camera) {
  if (!known) return nullptr;
  for (const CameraResult& result : known->cameras) {
    if (result.camera == camera && result.hand_eye) return &result;
  }
  return nullptr;
}

void planProbes(Pencil& pencil, std::vector<PlannedStop>& stops) {
  using Eigen::Vector3d;
  const Pose<Base, EndEffector> start = pencil.guard().kinematics().forward(pencil.q());
  const std::pair<const char*, Vector3d> axes[] = {
      {"x", Vector3d::UnitX()}, {"y", Vector3d::UnitY()}, {"z", Vector3d::UnitZ()}};
  for (const auto& [name, axis] : axes) {
    const auto turn = Pose<EndEffector, EndEffector>::fromRotationVector(kProbeRad * axis, Vector3d::Zero());
    stops.push_back(
        pencil.goTo(std::string("probe: at most 11 deg about the flange's ") + name, start * turn));
    stops.push_back(
        pencil.goTo(std::string("probe: at most 40 mm along the base's ") + name,
                    Pose<Base, EndEffector>(start.rotation(), start.translation() + kProbeM * axis)));
  }
  stops.push_back(pencil.goTo("probe: back at the start pose", start));
}

void planSweep(const SearchSweep& sweep, Pencil& pencil, std::vector<PlannedStop>& stops) {
  Eigen::VectorXd begin = sweep.posture_q, end = sweep.posture_q;
  begin[0] = sweep.from_rad;
  end[0] = sweep.to_rad;
  stops.push_back(pencil.goTo("search, if no camera sees the board at the start pose: from here", begin));
  const int steps = 1 + static_cast<int>(std::abs(sweep.to_rad - sweep.from_rad) / 0.05);
  PlannedStop tightest;
  for (int i = 1; i <= steps; ++i) {
    const double share = static_cast<double>(i) / steps;
    PlannedStop stop = pencil.goTo("search: turned to here", Eigen::VectorXd(begin + share * (end - begin)));
    if (i == 1 || (tightest.objection.empty() &&
                   (!stop.objection.empty() || stop.clearance_m < tightest.clearance_m))) {
      tightest = std::move(stop);
    }
  }
  tightest.what =
      "search: the narrowest place of the sweep, which takes " +
      std::to_string(static_cast<int>(std::lround(std::abs(sweep.to_rad - sweep.from_rad) / kSweepRadps))) +
      " s";
  stops.push_back(tightest);
}

}  // namespace

DryRun dryRun(const CellConfig& cell, const std::optional<CalibrationResult>& known) {
  const robot::Kinematics kinematics(cell.arm);
  SimulatedClock clock;
  StillArm arm(kinematics, cell.arm.start_q);
  robot::Guard guard(arm, kinematics, clock, cell);
  robot::CollisionModel bodies(cell.arm, cell.limits.keep_out, cell.board);
  DryRun plan;
  {
    Pencil pencil(guard, bodies, cell.arm.start_q);
    plan.start.push_back(pencil.goTo("start pose", cell.arm.start_q));
    plan.start.back().at_s = 0.0;
    planProbes(pencil, plan.start);
    plan.duration_s = pencil.timeS();
    Pencil other(guard, bodies, cell.arm.start_q);
    if (cell.arm.search) planSweep(*cell.arm.search, other, plan.start);
  }

  // What a run knows once it has found them: the board's mount, and what not to come near to.
  std::vector<robot::Sphere> obstacles;
  for (const CameraConfig& camera : cell.cameras) {
    const CameraResult* result = resultOf(known, camera.name);
    if (!result) continue;
    const HandEyeSolution& hand_eye = *result->hand_eye;
    if (camera.mount == Mount::kFlange) {
      obstacles = {{"board", hand_eye.board_pose.translation(), kBoardRadiusM}};
      continue;
    }
    const Pose<EndEffector, Board> eMo(hand_eye.board_pose);
    guard.setBoard(eMo);
    bodies.setBoard(eMo);
    obstacles.push_back({camera.name, hand_eye.camera_pose.translation(), kCameraRadiusM});
  }
  guard.setObstacles(obstacles);
  bodies.setObstacles(obstacles);

  Pencil pencil(guard, bodies, cell.arm.start_q);
  pencil.wait(plan.duration_s);
  for (const CameraConfig& camera : cell.cameras) {
    const CameraResult* result = resultOf(known, camera.name);
    if (!result) {
      PlannedCamera planned;
      planned.camera = camera.name;
      planned.unknown = known ? "the earlier result does not say where it stands"
                              : "where it stands is not known before a run; --result of an earlier one tells";
      plan.cameras.push_back(planned);
      continue;
    }
    const plan::Belief belief{result->intrinsics.camera, Pose<Base, Color>(result->hand_eye->camera_pose),
                              Pose<EndEffector, Board>(result->hand_eye->board_pose), camera.mount};
    plan.cameras.push_back(planCamera(cell, camera, belief, pencil));
  }
  plan.duration_s = pencil.timeS();
  return plan;
}

}  // namespace servocal::app
