// SPDX-License-Identifier: GPL-3.0-or-later
#include "board_turns.h"

#include <algorithm>
#include <cmath>

namespace servocal::calib {
namespace {

/// The board as it looks to somebody who does not see its mark.
BoardSpec withoutMark(BoardSpec board) {
  if (auto* checkerboard = std::get_if<Checkerboard>(&board.pattern)) checkerboard->hollow_corner = false;
  if (auto* circles = std::get_if<CircleGrid>(&board.pattern)) circles->bigger_corner_ratio = 1.0;
  return board;
}

}  // namespace

BoardTurns::BoardTurns(const BoardSpec& board) {
  const BoardSpec plain = withoutMark(board);
  for (int turn = 0; turn < plain.symmetry(); ++turn) {
    ids_.emplace_back();
    for (int id = 0; id < plain.cornerCount(); ++id) ids_.back().push_back(plain.turnedId(id, turn));
  }
}

int BoardTurns::count(const BoardDetection& detection) const {
  return detection.orientation_known ? 1 : all();
}

Pose<Board, Board> BoardTurns::rotation(int turn) const {
  return Pose<Board, Board>::fromRotationVector({0, 0, 2.0 * M_PI * turn / all()}, Eigen::Vector3d::Zero());
}

BoardDetection BoardTurns::turned(const BoardDetection& detection, int turn) const {
  BoardDetection out = detection;
  for (Corner& corner : out.corners) corner.id = id(corner.id, turn);
  std::sort(out.corners.begin(), out.corners.end(),
            [](const Corner& a, const Corner& b) { return a.id < b.id; });
  return out;
}

}  // namespace servocal::calib
