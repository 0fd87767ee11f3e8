// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "servocal/calib/joint.h"

namespace servocal::calib {

/// How much one part of the cell errs, beside what was said of it.
struct Budget {
  std::string
      part;  ///< "robot position", "robot orientation", "corners of k1 color", "board size", "board bow"
  std::string unit;     ///< "mm", "deg", "px", "%"
  double found = 0.0;   ///< One sigma for noise, the deviation itself for the board.
  double stated = 0.0;  ///< Declared by the cell file, claimed by the detector, expected of a print.
};

enum class FaultKind { kRobotNoise, kCornerNoise, kBoardSize, kBoardBowed, kBoardMoved, kCameraMoved };

/// Something that is not as it was said to be.
struct Fault {
  FaultKind kind = FaultKind::kRobotNoise;
  std::string camera;                 ///< Of kCornerNoise and kCameraMoved.
  std::optional<std::int64_t> since;  ///< Of what moved: the first observation after it.
  double moved_m = 0.0;               ///< Displacement and turn of what moved; NaN where it was too
                                      ///< far to be in the solution.
  double moved_rad = 0.0;
  double significance = 0.0;  ///< In standard deviations; for what moved, the root of its chi-square.
  std::string sentence;
};

struct Blame {
  std::vector<Budget> budgets;
  std::vector<Fault> faults;  ///< Worst first; empty if all is as stated.
};

/// Who is to blame for the residuals of a joint solution.
///
/// Noise is compared with what was declared (twice it, and significant), the board's size and bow with their
/// standard deviations (five, and 0.3 % or 0.3 mm). A camera that was moved (all its streams together) or a
/// board that slipped during the run shows as a step: for every stop, every camera and the board, the score
/// test of one pose before and another from that stop on, all else free, beyond what the arm's declared
/// accuracy can make look like one. What explains most is named; the others then are judged beside it no more,
/// since one step bends everything.
///
/// `observations` are those the solution was made from.
///
/// Source of the test: Rao, "Large sample tests of statistical hypotheses concerning several parameters",
/// 1948; the unknown moment as in Page, "Continuous inspection schemes", Biometrika 41, 1954.
Blame findFaults(const BoardSpec& board, const std::vector<Observation>& observations,
                 const JointSolution& solution);

}  // namespace servocal::calib
