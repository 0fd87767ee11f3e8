// SPDX-License-Identifier: GPL-3.0-or-later
// How far the board can be tilted before the detector loses it (the paper's stage of the same name).
#include <cmath>

#include "run.h"

namespace servocal::procedure {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr double kStepRad = 5.0 * kDegree;

struct Direction {
  const char* name;
  Eigen::Vector3d axis;  // in o: turns the board about its own centre
  double cap_rad;
};

}  // namespace

std::vector<TiltLimit> findTiltLimits(Run& run) {
  using Eigen::Vector3d;
  const std::vector<Direction> directions = {
      {"roll+", Vector3d::UnitZ(), 45 * kDegree},   {"roll-", -Vector3d::UnitZ(), 45 * kDegree},
      {"pitch+", Vector3d::UnitX(), 85 * kDegree},  {"pitch-", -Vector3d::UnitX(), 85 * kDegree},
      {"yaw+", Vector3d::UnitY(), 85 * kDegree},    {"yaw-", -Vector3d::UnitY(), 85 * kDegree}};
  const int planned = static_cast<int>(directions.size());

  servo::DriveOptions step_options;
  step_options.lost_tries = 1;  // losing the board is what the search is for
  step_options.settled_for = std::chrono::milliseconds(100);

  const Pose<Color, Board> cMo_facing(Eigen::Matrix3d::Identity(),
                                      {0, 0, 1.1 * run.cell().coverage.near_distance_m});
  run.report("tilt", 0, planned);
  run.visit("tilt", cMo_facing);
  run.updateBelief();
  const Eigen::VectorXd q_facing = run.guard().state().q;

  std::vector<TiltLimit> limits;
  for (const Direction& direction : directions) {
    TiltLimit limit{direction.name, 0.0, "cap"};
    for (double angle = kStepRad; angle <= direction.cap_rad + 1e-9; angle += kStepRad) {
      const auto turn = Pose<Board, Board>::fromRotationVector(angle * direction.axis, Vector3d::Zero());
      const Pose<Color, Board> cdMo = cMo_facing * turn;
      const auto q = run.guard().kinematics().inverse(run.flangeFor(cdMo), run.guard().state().q,
                                                      run.guard().limits().joint_margin_rad);
      if (!q || !run.guard().allows(*q)) {
        limit.ended_by = "reach";
        break;
      }
      const Run::Visit visit = run.visit("tilt", cdMo, step_options);
      if (!visit.observation) {
        const DriveStatus status = visit.drive.status;
        const bool out_of_reach = status == DriveStatus::kLimit || status == DriveStatus::kUnreachable;
        limit.ended_by = out_of_reach ? "reach" : "detection";
        break;
      }
      limit.limit_rad = angle;
    }
    limits.push_back(limit);
    run.updateBelief();
    run.report("tilt", static_cast<int>(limits.size()), planned,
               limit.direction + " " + std::to_string(std::lround(limit.limit_rad / kDegree)) + " deg, ended by " +
                   limit.ended_by);
    run.moveTo(run.guard().kinematics().forward(q_facing));
  }
  return limits;
}

}  // namespace servocal::procedure
