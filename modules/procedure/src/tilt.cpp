// SPDX-License-Identifier: GPL-3.0-or-later
// How far the board can be tilted before the detector loses it (the paper's stage of the same name).
#include <algorithm>
#include <cmath>

#include "resume.h"
#include "run.h"

namespace servocal::procedure {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr int kStepDeg = 5;     // resolution of a limit
constexpr int kStrideDeg = 15;  // first strides; a board is lost once per direction either way
constexpr int kCapDeg = 75;
// What tells most leans by 45 degrees against the image, a little more against the sight.
constexpr int kUsefulCapDeg = 60;

struct Direction {
  const char* name;
  Eigen::Vector3d axis;  // in o: turns the board about its own centre
  int cap_deg;           // a multiple of the stride
};

/// What one direction's search has found out about one stream.
struct Limit {
  int seen_deg = 0;
  std::optional<int> lost_deg;  // Smallest angle at which it did not see the board.

  void note(int angle_deg, bool seen) {
    if (seen) {
      if (!lost_deg || angle_deg < *lost_deg) seen_deg = std::max(seen_deg, angle_deg);
    } else {
      lost_deg = lost_deg ? std::min(*lost_deg, angle_deg) : angle_deg;
      if (seen_deg >= *lost_deg) seen_deg = *lost_deg - kStepDeg;
    }
  }
};

bool sees(const Observation& observation, const Eye& eye) {
  return std::any_of(observation.views.begin(), observation.views.end(), [&](const StreamObservation& view) {
    return view.camera == eye.camera() && view.stream == eye.stream();
  });
}

}  // namespace

void findTiltLimits(Run& run, Eye& color) {
  using Eigen::Vector3d;
  const int cap_deg = run.cell().planner.choose_by == Planner::kInformation ? kUsefulCapDeg : kCapDeg;
  std::vector<Direction> directions = {
      {"roll+", Vector3d::UnitZ(), 45},       {"roll-", -Vector3d::UnitZ(), 45},
      {"pitch+", Vector3d::UnitX(), cap_deg}, {"pitch-", -Vector3d::UnitX(), cap_deg},
      {"yaw+", Vector3d::UnitY(), cap_deg},   {"yaw-", -Vector3d::UnitY(), cap_deg}};
  const int planned = static_cast<int>(directions.size());
  directions.erase(
      std::remove_if(directions.begin(), directions.end(),
                     [&](const Direction& direction) { return hasTiltLimit(color, direction.name); }),
      directions.end());
  if (directions.empty()) return;  // Known from an earlier run, or from this one's first part.
  Eye* const infrared = run.find(color.camera(), Stream::kInfrared);

  servo::DriveOptions step_options;
  step_options.lost_tries = 1;  // losing the board is what the search is for
  step_options.settled_for = std::chrono::milliseconds(100);

  const Pose<Color, Board> cMo_facing(Eigen::Matrix3d::Identity(),
                                      {0, 0, 1.1 * run.cell().coverage.near_distance_m});
  run.report("tilt", color, 0, planned);
  run.visit("tilt", color, cMo_facing);
  run.updateBelief(color);
  const Pose<Base, EndEffector> bMe_facing = run.guard().state().bMe;

  for (const Direction& direction : directions) {
    if (color.tooLate()) break;
    Limit color_limit, infrared_limit;
    std::string ended_by = "cap";
    // Strides until the board is lost, then single steps from the last place where it was seen.
    for (int stride_deg = kStrideDeg, angle_deg = stride_deg; angle_deg <= direction.cap_deg;
         angle_deg += stride_deg) {
      const auto turn =
          Pose<Board, Board>::fromRotationVector(angle_deg * kDegree * direction.axis, Vector3d::Zero());
      const Pose<Color, Board> cdMo = cMo_facing * turn;
      const auto q = run.guard().kinematics().inverse(run.flangeFor(color, cdMo), run.guard().state().q,
                                                      run.guard().limits().joint_margin_rad);
      std::optional<Run::Visit> visit;
      if (q && run.guard().allows(*q)) visit = run.visit("tilt", color, cdMo, step_options);
      if (visit && visit->observation) {
        color_limit.note(angle_deg, true);
        if (infrared) infrared_limit.note(angle_deg, sees(*visit->observation, *infrared));
        continue;
      }
      const bool out_of_reach = !visit || visit->drive.status == DriveStatus::kLimit ||
                                visit->drive.status == DriveStatus::kUnreachable;
      ended_by = out_of_reach ? "reach" : "detection";
      if (stride_deg == kStepDeg) break;
      stride_deg = kStepDeg;
      angle_deg = color_limit.seen_deg;
    }
    color.tilt_limits.push_back({direction.name, color_limit.seen_deg * kDegree, ended_by, Stream::kColor});
    noteTiltLimit(run, color, color.tilt_limits.back());
    if (infrared && infrared->bMc()) {
      infrared->tilt_limits.push_back({direction.name, infrared_limit.seen_deg * kDegree,
                                       infrared_limit.lost_deg ? "detection" : ended_by, Stream::kInfrared});
      noteTiltLimit(run, *infrared, infrared->tilt_limits.back());
    }
    run.updateBelief(color);
    run.report("tilt", color, static_cast<int>(color.tilt_limits.size()), planned,
               std::string(direction.name) + " " + std::to_string(color_limit.seen_deg) + " deg, ended by " +
                   ended_by);
    run.moveTo(bMe_facing);
  }
}

}  // namespace servocal::procedure
