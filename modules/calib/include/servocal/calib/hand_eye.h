// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <vector>

#include "servocal/core/pose.h"

namespace servocal::calib {

/// One settled moment: arm at rest, robot pose and image taken at the same instant.
struct HandEyeView {
  Pose<Base, EndEffector> bMe;  ///< From the robot controller.
  Pose<Color, Board> cMo;       ///< From board detection.
};

struct HandEyeOptions {
  double min_rotation_rad = 0.05;  ///< View pairs that rotate less than this are not used.
  double min_axis_spread = 0.05;   ///< Below this HandEyeResult::axis_spread we refuse to answer.
  bool free_scale = false;         ///< Solve for the size of the board too, see HandEyeResult::scale.
};

enum class HandEyeStatus { kSolved, kTooFewViews, kRotationAxesParallel, kInconsistent, kNotConverged };

/// Sentence for the operator: what happened, and what to do about it.
const char* toString(HandEyeStatus status);

struct HandEyeResult {
  HandEyeStatus status = HandEyeStatus::kTooFewViews;
  double axis_spread = 0.0;  ///< 0: one rotation axis, or no motion. 1: two axes equally.
  std::optional<Pose<Base, Color>> bMc;         ///< This and all below: present only if kSolved.
  std::optional<Pose<EndEffector, Board>> eMo;  ///< Where the board sits on the flange.
  double scale = 1.0;  ///< If free: lengths by the robot over lengths by the board, that is, true over stated
                       ///< size of the board's squares. bMc and eMo are in the robot's lengths.
  double rms_translation_m = 0.0;  ///< Scatter over views. Fit, not accuracy: a few similar views
  double rms_rotation_rad = 0.0;   ///< fit perfectly and are still wrong.
};

/// Finds where a static camera stands from views of a board on the arm (solves A X = Z B).
///
/// Closed form; needs rotations about at least two non-parallel axes, and says so when they are
/// missing instead of returning an arbitrary answer. Seeds the nonlinear solve; is not its result.
/// For a camera on the flange, pass the inverse robot poses (relabel) and read eMc and bMo.
///
/// Source: Park & Martin, "Robot Sensor Calibration: Solving AX = XB on the Euclidean Group",
/// IEEE Trans. Robotics and Automation 10(5), 1994, p. 717.
///
/// @throws std::invalid_argument if any pose holds a non-finite number (names the view).
[[nodiscard]] HandEyeResult solveHandEye(const std::vector<HandEyeView>& views,
                                         const HandEyeOptions& options = {});

}  // namespace servocal::calib
