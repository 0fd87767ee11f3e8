// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/observation.h"
#include "servocal/core/result.h"
#include "servocal/procedure/calibrate.h"

namespace servocal::procedure {

/// What can have changed since a calibration.
enum class CheckPart { kCamera, kIntrinsics, kMount };
const char* toString(CheckPart part);  ///< "camera", "intrinsics", "mount"

/// One thing that changed, by how much.
struct CheckFinding {
  CheckPart part = CheckPart::kCamera;
  std::string camera;      ///< Of kCamera and kIntrinsics.
  Eigen::VectorXd change;  ///< kCamera: of its origin (m) and a turn about it (rad), along the base's axes.
                           ///< kMount: likewise of the board's origin, along the flange's axes.
                           ///< kIntrinsics: of the model's parameters.
  Eigen::VectorXd sigma;   ///< Standard deviations of change.
  double log_likelihood_ratio = 0;  ///< Against all being as it was, what was found before included.
  std::string sentence;             ///< For the operator: what, how much, what to do.
};

/// How one camera did.
struct CameraCheck {
  std::string camera;
  int views = 0;
  double rms_px =
      0.0;  ///< Where the stored calibration and the robot predict the corners, against where they are.
};

enum class CheckStatus {
  kOk,           ///< Nothing that the views could tell has changed.
  kChanged,      ///< See findings.
  kNotSeen,      ///< A camera does not see the board where it should: hidden, or moved far.
  kTooFewViews,  ///< Too little was seen to say anything.
};
const char* toString(CheckStatus status);  ///< "ok", "changed", "not_seen", "too_few_views"

struct CheckVerdict {
  CheckStatus status = CheckStatus::kTooFewViews;
  std::vector<CheckFinding> findings;  ///< The most certain first.
  std::vector<CameraCheck> cameras;
  std::string sentence;  ///< For the operator.
};

struct CheckOptions {
  double robot_sigma_m = 0.0003;  ///< Declared robot accuracy, 1 sigma per axis.
  double robot_sigma_rad = 0.0005;
  double false_alarm = 0.01;  ///< Probability of a finding when nothing has changed, if the result's standard
                              ///< deviations and the robot's accuracy hold.
};

/// Tests a stored calibration against a few views taken now, by likelihood ratio. The views' corners are
/// explained by
///
///   z = project(k_c, bMc^-1 bMe C_i eMo X) + noise
///
/// with a prior on everything: the stored intrinsics k_c with their covariance, the stored camera poses with theirs
/// (with 0.3 of the robot's accuracy added: its error is partly alike at all stops) and with what the hand-eye made up
/// for where those intrinsics are off, each camera's own eMo with its own, and one robot error C_i per stop. Then one part
/// at a time is set free: where a camera stands (6), its intrinsics, the mount (6). Twice the gain in log likelihood is
/// at most chi-square with as many degrees of freedom if nothing has changed; the part that explains most, if that is
/// more than chance (false_alarm divided by the number of parts), has changed. Then the rest is tested again with that
/// part free. Intrinsics are believed to be 1.4 times as uncertain as they claim; other correlations between what is
/// stored are not in the result. False alarms are rarer than declared.
///
/// Uses the color views of cameras that stand in the cell. Camera and mount differ by how the flange turns
/// between the views, camera and intrinsics by the board's distance: views must differ in both.
///
/// Source: generalized likelihood ratio with forward selection, e.g. S. M. Kay, "Fundamentals of Statistical
/// Signal Processing, Detection Theory", 1998, ch. 6; P. J. G. Teunissen, "Testing theory", 2006
/// (identification of the one model error of several).
///
/// @throws std::invalid_argument if a corner id is not the board's, or a sigma is not positive.
CheckVerdict judgeCalibration(const CalibrationResult& stored, const std::vector<Observation>& views,
                              const CheckOptions& options = {});

/// A calibration put right.
struct Repaired {
  CalibrationResult result;
  bool whole = false;  ///< False: something that changed could not be put right.
};

/// The stored calibration with what changed put right: camera poses and the mount, with the check's standard
/// deviations. Nothing else is touched; changed intrinsics cannot be repaired from a few views.
Repaired repaired(const CalibrationResult& stored, const CheckVerdict& verdict);

/// Board poses in a camera's image that tell apart what can have changed: places over the image, two
/// distances, turned and tilted each in its own way. The most useful first.
std::vector<Pose<Color, Board>> checkViews(const CameraModel& camera, double near_distance_m);

/// How many of them are taken of each camera, so that a check stays below a minute: 8 of one, 6 of each of two, 3 of
/// each of more.
int checkViewsOfEach(std::size_t cameras);

/// Drives to a handful of views of each camera, by the robot's states alone, observes there and judges. Every
/// observation is in the session first. Ends with the arm at rest.
/// @throws Error as calibrate(), and kInvalidConfig if the result holds no camera of the cell.
CheckVerdict check(const CellConfig& cell, const Devices& devices, const CalibrationResult& stored,
                   session::Session& session, const EventSink& on_event);

}  // namespace servocal::procedure
