// SPDX-License-Identifier: GPL-3.0-or-later
#include "known.h"

#include <cmath>

#include "format.h"
#include "resume.h"
#include "servocal/core/error.h"

namespace servocal::procedure {
namespace {

// Smaller differences are within what a few views and a replaced bolt make.
constexpr double kMountMovedM = 0.003;
constexpr double kMountMovedRad = 0.3 * M_PI / 180.0;

/// The camera that knows the mount best.
const HandEyeSolution* surestMount(const CalibrationResult& result) {
  const HandEyeSolution* surest = nullptr;
  const auto sigma = [](const HandEyeSolution& solution) { return solution.board_sigma.head<3>().norm(); };
  for (const CameraResult& camera : result.cameras) {
    if (camera.hand_eye && (!surest || sigma(*camera.hand_eye) < sigma(*surest))) surest = &*camera.hand_eye;
  }
  return surest;
}

}  // namespace

void believeKnown(Run& run, const CalibrationResult& known) {
  const HandEyeSolution* const mount = surestMount(known);
  if (!mount)
    throw Error(ErrorKind::kBadData, "the earlier result (--known) does not say how the board is mounted");
  if (mount->mount != run.mount()) {
    throw Error(ErrorKind::kBadData,
                "the earlier result (--known) is not of this cell: its cameras are mounted otherwise");
  }
  if (known.board.corners() != run.cell().board.corners()) {
    throw Error(ErrorKind::kBadData, "the earlier result (--known) is of another board than the cell file's");
  }
  run.believeMount(*mount);
  for (const CameraResult& camera : known.cameras) {
    for (const TiltLimit& limit : camera.tilt_limits) {
      Eye* const eye = run.find(camera.camera, limit.stream);
      if (!eye || hasTiltLimit(*eye, limit.direction)) continue;
      eye->tilt_limits.push_back(limit);
      noteTiltLimit(run, *eye, limit);
    }
  }
}

std::optional<std::string> mountChanged(const CalibrationResult& known, const CalibrationResult& now) {
  const HandEyeSolution *const before = surestMount(known), *const after = surestMount(now);
  if (!before || !after) return std::nullopt;
  const double moved_m = (after->board_pose.translation() - before->board_pose.translation()).norm();
  const double turned_rad =
      Eigen::AngleAxisd(before->board_pose.linear().transpose() * after->board_pose.linear()).angle();
  if (moved_m < kMountMovedM && turned_rad < kMountMovedRad) return std::nullopt;
  return format(
      "The board is not mounted as the earlier result says: it is %.1f mm and %.1f degrees from there. "
      "That mount was only a start; this result has the new one.",
      1e3 * moved_m, turned_rad * 180.0 / M_PI);
}

}  // namespace servocal::procedure
