// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "servocal/calib/joint.h"
#include "servocal/calib/uncertainty.h"

namespace servocal::calib {

/// Something that the description of a cell may have or not: a lens term, a bowed board, errors of the arm.
struct ModelTerm {
  std::string name;                          ///< "bow of the board"; for people.
  std::function<void(JointOptions&)> allow;  ///< Frees it.
};

/// How a description predicts views it was not fitted to.
struct ModelScore {
  std::string name;
  bool solved = false;      ///< In more than half of the blocks; the rest is meaningless otherwise.
  int views = 0;            ///< Held out once each.
  double rms_px = 0.0;      ///< Of the held-out views, robot believed.
  double rms_m = 0.0;       ///< As HeldOut::rms_m.
  double z = 0.0;           ///< HeldOut::z over all blocks.
  double gain = 0.0;        ///< Log density of the held-out views over that of the model kept before it.
  double gain_sigma = 0.0;  ///< Standard deviation of the gain, by the scatter of the stops.
  bool kept = false;        ///< The data support it.
};

struct ModelSelection {
  JointOptions options;            ///< The base with all terms that are kept.
  ModelScore score;                ///< Of these.
  std::vector<ModelScore> scores;  ///< The base, then each term beside what was kept before it.
  std::string sentence;            ///< What was kept and what the data do not support.
};

/// Adds terms to a base, one after the other: each is kept, and becomes part of what the next is compared
/// with, if the views that were not fitted are at least twenty times as probable with it, and their log density
/// grows by more than its standard deviation from stop to stop, so that a few stops alone do not decide. The
/// probability counts corner noise, robot noise and the model's own covariance.
///
/// Cross-validation by blocks of consecutive stops (by id): neighbors in time look alike, and one in the
/// fitted set would tell too much about another held out. A block has its share of the stops of every stream,
/// so that the rest determines all of them even where cameras had their turns one after the other. A stream
/// that the rest does not determine nevertheless is left out of that block under every description alike, and
/// the sentence says so. Each description is solved once per block.
///
/// Nothing if no more than half of the blocks are solved with the base.
///
/// @throws std::invalid_argument for fewer than two blocks.
std::optional<ModelSelection> selectModel(const BoardSpec& board,
                                          const std::vector<Observation>& observations,
                                          const JointOptions& base, const std::vector<ModelTerm>& terms,
                                          int blocks = 5);

}  // namespace servocal::calib
