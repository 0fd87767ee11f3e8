// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/core/observation.h"
#include "servocal/core/pose.h"

namespace servocal::calib {

/// Where the board was in an image that was taken while the arm moved.
struct TimedBoard {
  Instant stamp{};
  Pose<Color, Board> cMo;
};

struct TimeOffsetOptions {
  double search_s = 0.3;  ///< Offsets up to this, either way.
  int min_samples = 15;
  double min_motion_m = 0.01;  ///< RMS displacement of the board about its mean, below which it did not move.
  double max_sigma_s = 0.005;  ///< Above it the answer is refused.
};

enum class TimeOffsetStatus { kSolved, kTooFewSamples, kNoMotion, kBeyondSearch, kUncertain };
/// Sentence for the operator: what happened, and what to do about it.
const char* toString(TimeOffsetStatus status);

struct TimeOffset {
  TimeOffsetStatus status = TimeOffsetStatus::kTooFewSamples;
  double offset_s = 0.0;  ///< Image stamps minus robot stamps: an image stamped t shows the arm at t -
                          ///< offset_s. This and below: only if kSolved.
  double sigma_s = 0.0;  ///< By the scatter of the residuals.
  double rms_m = 0.0;    ///< Of the board's centre, paths aligned. Fit, not accuracy.
  int samples = 0;       ///< That were used.
};

/// The offset of a camera's stamps against the robot's, from the board's path seen by both while the arm
/// moves.
///
/// For every offset the path of the board's centre by the camera is laid onto that by the robot as well as a
/// rigid motion can (so the camera's pose is not needed); the offset with the least squares wins. Samples
/// that stand out are left out. `eMo` need only be roughly known: its error counts as far as the flange
/// turns. Samples near gaps of the robot's history (0.1 s) do not count. Speeds must change: along a straight line at constant speed every offset fits, and the answer is
/// refused.
///
/// Source: alignment of paths: K. S. Arun, T. S. Huang, S. D. Blostein, "Least-Squares Fitting of Two 3-D
/// Point Sets", PAMI 9(5), 1987.
///
/// @throws std::invalid_argument unless `states` rise in time and all poses are finite.
[[nodiscard]] TimeOffset estimateTimeOffset(const std::vector<TimedBoard>& samples,
                                            const std::vector<RobotState>& states,
                                            const Pose<EndEffector, Board>& eMo,
                                            const TimeOffsetOptions& options = {});

}  // namespace servocal::calib
