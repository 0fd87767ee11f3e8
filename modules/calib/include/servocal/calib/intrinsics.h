// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::calib {

/// How much each corner counts.
///
/// kEqual minimizes the very RMS that is reported and reaches the optimum of cv::calibrateCamera. It is
/// the default because what dominates on real boards (print, bow, light) is common to sharp and blurred
/// views alike, and whitening would believe the sharp ones beyond it. kCovariance is maximum likelihood
/// where the detector's covariances hold, as in simulation.
enum class CornerWeighting { kEqual, kCovariance };

/// What is known of a camera before any view: lets a handful of views give a sane camera model.
struct IntrinsicsPrior {
  CameraModel camera;          ///< Nominal; the solve starts here.
  Eigen::MatrixXd covariance;  ///< Of camera.parameters, order and units of those; positive definite.
};

/// Standard deviations of a data sheet: focal length 5 % (its two numbers alike within 1 %), principal
/// point 30 px, k1 0.15, k2 0.3, p1 and p2 0.005, k3 0.3 and, of the rational lens, k4 to k6 0.3.
IntrinsicsPrior nominalPrior(const CameraModel& nominal);

struct IntrinsicsOptions {
  LensModel lens = LensModel::kPlumbBob;
  std::vector<std::string> fixed;  ///< Parameters held at their start value (0 for distortion), by name,
                                   ///< e.g. {"k3"} or {"p1", "p2", "k3"}.
  CornerWeighting weighting = CornerWeighting::kEqual;
  std::optional<IntrinsicsPrior> prior;  ///< For live estimates from few views; the final result uses none.
  int min_views = 3;
  double max_condition = 1e9;      ///< Of the scaled normal matrix of fx, fy, cx, cy with the rest eliminated;
                                   ///< above it the answer is refused.
  double max_focal_sigma = 0.1;    ///< Standard deviation of fx over fx; above it the answer is refused.
  double outlier_ratio = 3.0;      ///< A view whose RMS is more than this many times the median (and more
                                   ///< than 0.3 px and the spread of the views) is left out and named. 0: all
                                   ///< views are kept.
};

enum class IntrinsicsStatus { kSolved, kTooFewViews, kViewsParallel, kNotConverged };
/// Sentence for the operator: what happened, and what to do about it.
const char* toString(IntrinsicsStatus status);

struct IntrinsicsOutcome {
  IntrinsicsStatus status = IntrinsicsStatus::kTooFewViews;
  std::optional<IntrinsicsResult> result;  ///< Present only if kSolved.
};

/// Camera intrinsics from views of a planar board, from images alone (the robot is not asked).
///
/// Closed-form start, then maximum likelihood over intrinsics and one board pose per view, with
/// standard deviations from the inverse normal matrix scaled by the residual (2N - p degrees of
/// freedom for N corners and p parameters, those of the board poses included). Refuses views that are
/// all parallel, which leave the focal length undetermined. A distortion term the data hardly determine
/// is no reason to refuse; its standard deviation says so.
///
/// Views that do not fit the others are left out and named, with the cause (ViewResidual): without a prior,
/// up to a third of the views may be wrong in any way. Where views disagree the camera is first sought by
/// samples of views (least median of squares; Rousseeuw, JASA 79, 1984), and every view is judged anew in
/// each round. A view is blurred if its claimed corner sigma is three times the others' and its residual
/// 2.5 times and more than 0.15 px.
///
/// Uses the views of one camera and stream, all of one image size; IntrinsicsResult::views keeps their
/// order. The answer does not depend on it.
///
/// Source: Z. Zhang, "A Flexible New Technique for Camera Calibration", IEEE TPAMI 22(11), 2000.
///
/// @throws std::invalid_argument if image sizes differ, a fixed parameter's name or a corner id is
///   unknown, or the prior is of another lens, another image size or not positive definite.
[[nodiscard]] IntrinsicsOutcome solveIntrinsics(const BoardSpec& board,
                                                const std::vector<Observation>& observations,
                                                const std::string& camera, Stream stream,
                                                const IntrinsicsOptions& options = {});

}  // namespace servocal::calib
