// SPDX-License-Identifier: GPL-3.0-or-later
// From one camera's turn to the next one's.
#include "run.h"

namespace servocal::procedure {

std::optional<std::string> handOver(Run& run, Eye& eye) {
  if (!eye.bMc() && !eye.sighting) {
    return "it never saw the board" + eye.whyBlind() +
           "; point it at the space the arm reaches, or give it a start pose";
  }
  if (!eye.bMc()) {
    if (auto blocked = run.travelTo(eye.sighting->robot.bMe)) return blocked;
    if (!run.observe("find", eye) || !eye.bMc()) return "the board was seen in passing, but not at rest";
    return std::nullopt;
  }
  // Facing the camera, as near to its axis as the arm reaches.
  const double near_m = run.cell().coverage.near_distance_m;
  std::string why = "the arm reaches no view that faces it";
  for (const double distance_m : {1.1 * near_m, 1.4 * near_m, 1.7 * near_m, 2.0 * near_m}) {
    const Pose<Color, Board> cMo_facing(Eigen::Matrix3d::Identity(), {0, 0, distance_m});
    if (const auto blocked = run.travelTo(run.flangeFor(eye, cMo_facing))) {
      why = *blocked;
      continue;
    }
    if (run.observe("find", eye)) {
      if (const auto unknown = run.updateBelief(eye)) return unknown;
      return std::nullopt;
    }
    why = "the board was not seen where it should be";
  }
  return why;
}

}  // namespace servocal::procedure
