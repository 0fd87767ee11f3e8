// SPDX-License-Identifier: GPL-3.0-or-later
// Where the reprojection solve starts: which of several possible board poses each image shows, and the
// closed form on those.
#pragma once

#include <vector>

#include "servocal/calib/hand_eye.h"
#include "servocal/core/board_spec.h"

namespace servocal::calib {

/// One possible board pose of a view.
struct BoardPoseCandidate {
  Pose<Color, Board> cMo;
  bool turned = false;  ///< Explains the image with the corner ids of the board turned by half a turn.
};

struct CandidateView {
  Pose<Base, EndEffector> bMe;
  std::vector<BoardPoseCandidate> candidates;  ///< Best fit first; empty: none was found.
};

struct HandEyeStart {
  HandEyeStatus status = HandEyeStatus::kTooFewViews;
  double axis_spread = 0.0;
  Pose<Base, Color> bMc;  ///< Set, like the rest, only if kSolved.
  Pose<EndEffector, Board> eMo;
  std::vector<int> choice;  ///< Per view, the candidate that agrees with the robot; -1 if none does.
};

/// HandEyeResult::axis_spread of robot rotations.
double axisSpread(const std::vector<Eigen::Matrix3d>& bRe, double min_rotation_rad);

/// The candidate of `view` nearest to the pose that `bMc` and `eMo` predict; -1 if all are so far off
/// that another planar solution, a turned board or a foreign robot pose is the likelier reason.
int nearestCandidate(const BoardSpec& board, const CandidateView& view, const Pose<Base, Color>& bMc,
                     const Pose<EndEffector, Board>& eMo);

/// Chooses the candidates that agree with the robot and solves the closed form on them.
///
/// First with the best-fitting candidate of every view and a few rounds of choosing anew; if that leaves
/// many views in contradiction, by random samples of three views whose rotation angles agree between robot
/// and camera (an angle is the same seen from either, whatever the unknown poses). Deterministic. If a
/// half turn of the board in all views at once fits as well, the first view keeps its ids.
///
/// Source: consensus by sampling after Fischler & Bolles, "Random Sample Consensus", CACM 24(6), 1981.
HandEyeStart startHandEye(const BoardSpec& board, const std::vector<CandidateView>& views,
                          const HandEyeOptions& options);

}  // namespace servocal::calib
