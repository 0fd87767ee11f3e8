// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::calib {

struct IntrinsicsOptions {
  LensModel lens = LensModel::kPlumbBob;
  std::vector<std::string> fixed;  ///< Parameters held at their start value (0 for distortion), by name,
                                   ///< e.g. {"k3"} or {"p1", "p2", "k3"}.
  int min_views = 3;
  double max_condition = 1e9;      ///< Of the scaled normal matrix; above it the answer is refused.
};

enum class IntrinsicsStatus { kSolved, kTooFewViews, kViewsParallel, kNotConverged };
const char* toString(IntrinsicsStatus status);

struct IntrinsicsOutcome {
  IntrinsicsStatus status = IntrinsicsStatus::kTooFewViews;
  std::optional<IntrinsicsResult> result;  ///< Present only if kSolved.
};

/// Camera intrinsics from views of a planar board, from images alone (the robot is not asked).
///
/// Closed-form start, then maximum likelihood over intrinsics and one board pose per view, with
/// standard deviations from the inverse normal matrix scaled by the residual (2N - p degrees of
/// freedom). Refuses views that are all parallel, which leave the focal length undetermined.
///
/// `views`: those of one camera and stream; all of one image size. Results keep their order.
///
/// Source: Z. Zhang, "A Flexible New Technique for Camera Calibration", IEEE TPAMI 22(11), 2000.
///
/// @throws std::invalid_argument if image sizes differ or a fixed parameter's name is unknown.
[[nodiscard]] IntrinsicsOutcome solveIntrinsics(const BoardSpec& board,
                                                const std::vector<Observation>& observations,
                                                const std::string& camera, Stream stream,
                                                const IntrinsicsOptions& options = {});

}  // namespace servocal::calib
