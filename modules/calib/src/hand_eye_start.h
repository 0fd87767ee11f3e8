// SPDX-License-Identifier: GPL-3.0-or-later
// Where the reprojection solve starts: which of several possible board poses each image shows, and the
// closed form on those.
#pragma once

#include <vector>

#include "board_turns.h"
#include "servocal/calib/hand_eye.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"

namespace servocal::calib {

/// One possible board pose of a view.
struct BoardPoseCandidate {
  Pose<Color, Board> cMo;
  int turn = 0;  ///< Explains the image with the corner ids of this turn of the board (BoardTurns).
  bool better_fitting = true;  ///< Of the two poses that a plane has, the one that fits the image better.
  double rms_px = 0.0;         ///< BoardPose::rms_px.
};

struct CandidateView {
  Pose<Base, EndEffector> bMe;
  std::vector<BoardPoseCandidate> candidates;  ///< Best fit first; empty: none was found.
};

/// All board poses that could explain a detection: both of the plane, in every turn it leaves open.
CandidateView candidateView(const BoardSpec& board, const BoardTurns& turns, const CameraModel& camera,
                            const BoardDetection& detection, const Pose<Base, EndEffector>& bMe);

struct HandEyeStart {
  HandEyeStatus status = HandEyeStatus::kTooFewViews;
  double axis_spread = 0.0;
  Pose<Base, Color> bMc;  ///< Set, like the rest, only if kSolved.
  Pose<EndEffector, Board> eMo;
  double scale = 1.0;       ///< HandEyeResult::scale.
  std::vector<int> choice;  ///< Per view, the candidate that agrees with the robot; -1 if none does.
};

/// HandEyeResult::axis_spread of robot rotations.
double axisSpread(const std::vector<Eigen::Matrix3d>& bRe, double min_rotation_rad);

/// The candidate of `view` nearest to the pose that `bMc` and `eMo` predict; -1 if all are so far off
/// that another planar solution, a turned board or a foreign robot pose is the likelier reason.
int nearestCandidate(const BoardSpec& board, const CandidateView& view, const Pose<Base, Color>& bMc,
                     const Pose<EndEffector, Board>& eMo);

/// Mean distance of the pattern's four corners between two board poses, m.
double cornerDistance(const BoardSpec& board, const Pose<Color, Board>& first,
                      const Pose<Color, Board>& second);

/// Chooses the candidates that agree with the robot and solves the closed form on them.
///
/// First with the best-fitting candidate of every view and a few rounds of choosing anew; if that leaves
/// many views in contradiction, by random samples of three views whose rotation angles agree between robot
/// and camera (an angle is the same seen from either, whatever the unknown poses). Deterministic. With
/// options.free_scale the size of the board is found as well.
///
/// Source: consensus by sampling after Fischler & Bolles, "Random Sample Consensus", CACM 24(6), 1981.
HandEyeStart startHandEye(const BoardSpec& board, const std::vector<CandidateView>& views,
                          const HandEyeOptions& options);

}  // namespace servocal::calib
