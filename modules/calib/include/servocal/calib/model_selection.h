// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/calib/joint.h"
#include "servocal/calib/uncertainty.h"

namespace servocal::calib {

/// One way to describe the cell: which lens, which terms fixed, board or robot free in what.
struct ModelCandidate {
  std::string name;  ///< "lens with k3", "bowed board", "arm's geometry"; for people.
  JointOptions options;
};

/// How a candidate predicts views it was not fitted to.
struct ModelScore {
  std::string name;
  bool solved = false;      ///< In every block; the rest is meaningless otherwise.
  double rms_px = 0.0;      ///< Of the held-out views, robot believed.
  double z = 0.0;           ///< HeldOut::z over all blocks.
  double gain = 0.0;        ///< Log density of the held-out views over that of the model kept before it.
  double gain_sigma = 0.0;  ///< Standard deviation of the gain, by the scatter of the stops.
  bool kept = false;        ///< The data support it.
};

struct ModelSelection {
  std::size_t chosen = 0;  ///< Index into the candidates.
  std::vector<ModelScore> scores;
  std::string sentence;  ///< What was kept and what the data do not support.
};

/// Chooses among candidates from lean to rich: the first is the base, each further one is kept, and becomes
/// what the next is compared with, if the views it was not fitted to are the more probable by twice the
/// standard deviation of the difference. The probability counts corner noise, robot noise and the model's own
/// covariance.
///
/// Cross-validation by blocks of consecutive stops (by id): neighbors in time look alike, and one in the
/// fitted set would tell too much about another held out. Each candidate is solved once per block.
///
/// Nothing if the first candidate is not solved in every block.
///
/// @throws std::invalid_argument if there is no candidate or fewer than two blocks.
std::optional<ModelSelection> selectModel(const BoardSpec& board,
                                          const std::vector<Observation>& observations,
                                          const std::vector<ModelCandidate>& candidates, int blocks = 5);

}  // namespace servocal::calib
