// SPDX-License-Identifier: GPL-3.0-or-later
// The turns of a board about its normal that one image cannot tell apart.
#pragma once

#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/observation.h"
#include "servocal/core/pose.h"

namespace servocal::calib {

/// What is left open where a detection does not know the board's orientation: the turns of a symmetric
/// pattern, or of a marked one whose mark was not seen. Turn 0 is the ids as they came.
class BoardTurns {
 public:
  explicit BoardTurns(const BoardSpec& board);

  /// Turns that explain the image alike, the first included; 1 if its orientation is known.
  int count(const BoardDetection& detection) const;
  /// The corner that is meant by `id` if the detection is read with this turn.
  int id(int id, int turn) const {
    return ids_[static_cast<std::size_t>(turn)][static_cast<std::size_t>(id)];
  }
  /// Takes the board pose read with this turn to the one read with the ids as they came, by the right:
  /// cMo(0) = cMo(turn) * rotation(turn).
  Pose<Board, Board> rotation(int turn) const;
  /// The same detection with the ids of a turn, sorted by id.
  BoardDetection turned(const BoardDetection& detection, int turn) const;
  /// The turn that is `second` as seen from `first`.
  int between(int first, int second) const { return (second - first + all()) % all(); }

 private:
  int all() const { return static_cast<int>(ids_.size()); }

  std::vector<std::vector<int>> ids_;  // by turn, by id
};

}  // namespace servocal::calib
