// SPDX-License-Identifier: GPL-3.0-or-later
#include "goals.h"

#include <algorithm>

#include "format.h"

namespace servocal::procedure {
namespace {

constexpr double kBelievedZ = 2.0;  // of views not seen, over what was claimed
// Of what two independent halves differ by, likewise. It is mostly one corner of the image: twice as much
// comes by chance in one of ten cells of three cameras.
constexpr double kBelievedHalves = 3.0;

}  // namespace

std::vector<std::string> goalsMissed(const std::vector<Known>& streams, const PlannerConfig& goals) {
  std::vector<std::string> missed;
  for (const Known& stream : streams) {
    // Not '>': a number that is none has not been reached.
    if (!(stream.projection_px <= goals.projection_goal_px)) {
      missed.push_back(format("%s: its projection is uncertain by %.2f px at worst, wanted are %.2f px",
                              stream.name.c_str(), stream.projection_px, goals.projection_goal_px));
    }
    if (!(stream.point_m <= goals.point_goal_m)) {
      missed.push_back(
          format("%s: points of the workspace are uncertain by %.2f mm at worst, wanted are %.2f mm",
                 stream.name.c_str(), 1e3 * stream.point_m, 1e3 * goals.point_goal_m));
    }
  }
  return missed;
}

std::vector<std::string> goalsMissed(const JointResult& joint, const PlannerConfig& goals) {
  std::vector<Known> streams;
  for (const JointCameraResult& camera : joint.cameras) {
    streams.push_back({camera.camera + " " + toString(camera.stream),
                       std::max(camera.at_infinity.worst_px, camera.at_range.worst_px),
                       camera.workspace.worst_m});
  }
  std::vector<std::string> missed = goalsMissed(streams, goals);
  for (const JointCameraResult& camera : joint.cameras) {
    if (camera.halves && !(camera.halves->rms_px <= kBelievedHalves * camera.halves->claimed_px)) {
      missed.push_back(format(
          "%s %s: every other stop and the rest differ by %.2f px where %.2f px are claimed: the "
          "lens model, the board or the arm's geometry is not described well enough",
          camera.camera.c_str(), toString(camera.stream), camera.halves->rms_px, camera.halves->claimed_px));
    }
  }
  if (joint.held_out && !(joint.held_out->z <= kBelievedZ)) {
    missed.push_back(
        format("views that no solver saw are off by %.1f times what is claimed", joint.held_out->z));
  }
  return missed;
}

}  // namespace servocal::procedure
