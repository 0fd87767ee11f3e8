// SPDX-License-Identifier: GPL-3.0-or-later
// One stream's part of a solution.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "servocal/calib/reprojection.h"
#include "servocal/procedure/solve.h"

namespace servocal::procedure {

/// Solves one stream of one camera: intrinsics, and with robot poses the hand-eye. What comes out stands in the
/// fields of a color camera; an infrared's are moved by the caller.
class StreamSolver {
 public:
  StreamSolver(const BoardSpec& board, const std::vector<Observation>& observations, const std::string& camera,
               Stream stream, const SolveOptions& options);

  /// Nothing without intrinsics; missing() says why.
  std::optional<CameraResult> solve(bool has_robot);
  const std::vector<std::string>& missing() const { return missing_; }

 private:
  std::optional<IntrinsicsResult> solveIntrinsics();
  void solveHandEye();
  std::optional<std::string> findContradiction(const calib::HandEyeOutcome& outcome);
  void noteWhatTheRobotDecided();
  const CameraModel& model() const { return result_.intrinsics.camera; }
  /// "cam1", or "cam1 infrared".
  std::string name() const;

  const BoardSpec& board_;
  const std::vector<Observation>& observations_;
  Stream stream_;
  const SolveOptions& options_;
  CameraResult result_;
  std::vector<std::string> missing_;
};

}  // namespace servocal::procedure
