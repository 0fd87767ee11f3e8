// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

#include "point_servo.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/pose.h"
#include "servocal/servo/drive.h"

namespace servocal::servo {

/// Where the target is in the camera at one instant.
struct View {
  Pose<Color, Board> cMo;
  Pose<Color, EndEffector> cMe;
  double sign = 1.0;  ///< Of what the flange's motion does to the target in the image: -1 if it carries the camera.
  std::vector<ImagePoint> points;
};

/// Carries the last sight of the target forward by what the arm has moved since:
///   cMo(now) = cMo(stamp) oMe bMe(stamp)^-1 bMe(now) eMo,
/// or, with the camera on the flange,
///   cMo(now) = cMe bMe(now)^-1 bMe(stamp) eMc cMo(stamp).
/// A frame is 60 to 100 ms old when it is used; without this the loop would have to be slow to be
/// stable. It needs only the mount, and a wrong mount costs only its share of that short motion.
class ViewTracker {
 public:
  ViewTracker(const std::vector<Eigen::Vector3d>& points_o, const CellEstimate& cell);

  /// Takes a new sight and the flange pose at its stamp. False, and nothing changes, if the sight cannot
  /// be right: not finite, wrong number of points, a pixel no point projects to, a point behind.
  bool update(const Sight& sight, const Pose<Base, EndEffector>& bMe_seen);
  /// The view with the flange at bMe. The measured points are moved, not replaced by a model's: the
  /// goal is met in pixels even if the camera model is rough.
  View at(const Pose<Base, EndEffector>& bMe) const;

 private:
  std::vector<Eigen::Vector3d> points_o_;
  CellEstimate cell_;
  Pose<Color, Board> cMo_seen_;
  Pose<Base, EndEffector> bMe_seen_;
  std::vector<Eigen::Vector2d> measured_minus_model_;
};

/// Normalized coordinates and depths of points at a pose; depths are kept above 1 mm.
std::vector<ImagePoint> imagePoints(const Pose<Color, Board>& cMo,
                                    const std::vector<Eigen::Vector3d>& points_o);

}  // namespace servocal::servo
