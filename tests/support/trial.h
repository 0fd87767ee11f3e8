// SPDX-License-Identifier: GPL-3.0-or-later
// One whole calibration of the simulated cell, measured against its truth.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "joint_errors.h"
#include "pair_errors.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/result.h"
#include "servocal/procedure/calibrate.h"

namespace servocal::sim {
class Cell;
}

namespace servocal::test {

/// What one camera of the result is off by, against the truth.
struct CameraErrors {
  std::string camera;
  double pose_m = 0.0;  ///< bMc, at the color camera's origin.
  double pose_rad = 0.0;
  std::optional<double> infrared_m;  ///< cMi, at the infrared camera's origin.
  std::optional<double> infrared_rad;
  /// Systematic depth error (white, without noise): RMS over 8 x 6 places of the image and five ranges inside
  /// those visited, as measured and corrected; and corrected, beyond those visited, up to 1.5 m.
  std::optional<double> depth_before_m;
  std::optional<double> depth_after_m;
  std::optional<double> depth_beyond_m;
};

struct Trial {
  CalibrationResult result;
  std::vector<CameraErrors> errors;       ///< Of every camera that has a hand-eye.
  std::vector<JointErrors> joint_errors;  ///< Of every stream of the joint estimate,
  std::vector<JointErrors>
      without_arm;  ///< and of one of the same views with the arm as it reports, if asked for.
  std::vector<CameraPairErrors> pairs;  ///< Every two cameras against each other.
  std::vector<PlaneShot> plane_shots;   ///< Taken after the run, for the pairs' planes.
  int reachable_cells = 0;              ///< By the truth; see reachable_cells.h.
  int cells = 0;
  int filled_reachable_cells = 0;  ///< Of them, filled.
  int coverage_views = 0;
  int target_losses = 0;        ///< Drives outside the tilt search that ended with the target lost.
  double camera_error_m = 0.0;  ///< Estimated against true bMc, at the camera's origin.
  double camera_error_rad = 0.0;
  /// RMS error of the board's corners mapped to the base through the estimated intrinsics and bMc, with the
  /// board at five places of the workspace.
  std::array<double, 5> board_point_error_m{};
  double wall_s = 0.0;
  double cpu_s = 0.0;
};

/// Of every camera that has a hand-eye; `cell` is the one that was calibrated, or one of the same seed.
std::vector<CameraErrors> cameraErrors(sim::Cell& cell, const CalibrationResult& result);

/// Calibrates `cell` with `seed`; the session goes to `folder`.
Trial runTrial(const CellConfig& cell, std::uint64_t seed, const std::filesystem::path& folder,
               const procedure::CalibrateOptions& options = {}, bool also_without_arm = false);

}  // namespace servocal::test
