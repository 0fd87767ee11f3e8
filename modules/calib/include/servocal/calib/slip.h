// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/pose.h"

namespace servocal::calib {

/// What one fixed camera saw at one stop.
struct SlipView {
  std::int64_t observation_id = 0;  ///< Rises in time.
  std::string camera;
  Pose<Base, EndEffector> bMe;  ///< From the robot.
  Pose<Color, Board> cMo;       ///< From this image alone.
};

struct SlipOptions {
  /// A step that displaces the board by less than min_step_m and turns by less than min_step_rad is not
  /// reported: a robot's own error is alike at neighboring stops, and a step between two regions of the
  /// workspace is as significant as a slip, but no larger than that error.
  double min_step_m = 0.0015;
  double min_step_rad = 0.0026;  // 0.15 degrees
  int min_views = 4;             ///< On either side of the step.
  /// Nominal probability, per call, that errors which are Gaussian and do not depend on the order of views
  /// pass for a step of any size. Leaving out views that stand out makes it some four times higher.
  double false_alarm = 1e-3;
};

/// What moved: board against flange, which every camera sees alike, or one camera.
enum class SlipPart { kMount, kCamera };
const char* toString(SlipPart part);  ///< "mount", "camera"

struct Slip {
  SlipPart part = SlipPart::kMount;
  std::string camera;                                ///< Of kCamera.
  std::int64_t observation_id = 0;                   ///< The first one after the step.
  Eigen::Vector3d step_m = Eigen::Vector3d::Zero();  ///< kMount: of the board's origin, along the flange's
                                                     ///< axes. kCamera: of the camera, as a rigid body, at
                                                     ///< the mean place of its boards, along the base's axes.
  Eigen::Vector3d step_rad = Eigen::Vector3d::Zero();  ///< Rotation vector along the same axes.
  double log_likelihood_ratio = 0.0;                   ///< Against no step.
  std::string sentence;                                ///< For the operator.
};

/// Whether and when something moved that should not have, in a sequence of views: the mount slipped, or a
/// camera was bumped. `bMc` of each camera and `eMo` are as solved so far, also from views on both sides of
/// the step.
///
/// Each view alone says where the board is on the flange (and where its camera is in the base). For every
/// place in the sequence the mean before is compared with the mean after (Hotelling's T^2 of displacement and
/// turn, with the scatter estimated from the views themselves, one mean per camera); the part and the place
/// with the highest likelihood are reported if chance, times the number of places and parts tried, is below
/// false_alarm and the step large enough. Single views that stand out are left out first.
///
/// With wrong intrinsics the views' errors depend on where the board is in the image, and an order of views
/// from near to far looks like a step: call it with the current intrinsics. With one camera, mount and camera
/// differ only by how the flange turns between views: with 20 views that turn by 0.4 rad the part and the
/// place are right in two of three cases.
///
/// Source: change point by likelihood ratio: M. S. Srivastava & K. J. Worsley, "Likelihood Ratio Tests for a
/// Change in the Multivariate Normal Mean", JASA 81, 1986.
///
/// @throws std::invalid_argument if a pose is not finite or a camera has no bMc.
std::optional<Slip> findSlip(const std::vector<SlipView>& views,
                             const std::map<std::string, Pose<Base, Color>>& bMc,
                             const Pose<EndEffector, Board>& eMo, const SlipOptions& options = {});

}  // namespace servocal::calib
