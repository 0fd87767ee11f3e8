// SPDX-License-Identifier: GPL-3.0-or-later
// What a simulated cell hides. For tests alone: nothing under modules/ or apps/ may include this.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "servocal/core/camera_model.h"
#include "servocal/core/clock.h"
#include "servocal/core/pose.h"
#include "servocal/sim/cell.h"

namespace servocal::sim {

struct InfraredTruth;

/// The truth of a simulated cell. It must not outlive the cell.
class Truth {
 public:
  explicit Truth(Cell& cell);

  /// True intrinsics; OpenCV's model and order (plumb bob).
  CameraModel camera(const std::string& name) const;
  CameraModel infrared(const std::string& camera) const;
  Pose<Color, Infrared> cMi(const std::string& camera) const;

  /// Systematic depth error of white surfaces, without noise and quantisation: the depth (m) at a pixel of
  /// the depth image where the camera measures `measured_m`, and the inverse.
  double trueDepth(const std::string& camera, const Eigen::Vector2d& pixel, double measured_m) const;
  double measuredDepth(const std::string& camera, const Eigen::Vector2d& pixel, double true_m) const;

  /// Now or at an instant: faults move cameras and board, and the arm moves what is on its flange (known for
  /// the last two seconds).
  Pose<Base, Color> bMc(const std::string& camera) const;
  Pose<Base, Color> bMc(const std::string& camera, Instant instant) const;
  Pose<EndEffector, Color> eMc(const std::string& camera,
                               Instant instant) const;  ///< Of cameras on the flange.
  Pose<EndEffector, Board> eMo() const;                 ///< Of a board there.
  Pose<EndEffector, Board> eMo(Instant instant) const;
  Pose<Base, Board> bMo(Instant instant) const;

  /// Where the flange really is, now or at an instant of the last two seconds. What the arm reports
  /// differs by its kinematic errors and its repeatability.
  Pose<Base, EndEffector> bMe() const;
  Pose<Base, EndEffector> bMe(Instant instant) const;
  /// Where it really is at these joint angles, but for repeatability.
  Pose<Base, EndEffector> bMe(const Eigen::VectorXd& q) const;
  /// Joint angles without encoder noise.
  Eigen::VectorXd q() const;
  Eigen::VectorXd q(Instant instant) const;

  Pose<Color, Board> cMo(const std::string& camera, Instant instant) const;
  /// True pixels of the board's corners by id at an instant, e.g. a frame's stamp; may lie outside.
  std::vector<Eigen::Vector2d> corners(const std::string& camera, Instant instant,
                                       Stream stream = Stream::kColor) const;

  std::int64_t framesRendered(const std::string& camera) const;

 private:
  const InfraredTruth& infraredOf(const std::string& camera) const;

  Cell::Impl* impl_;
};

}  // namespace servocal::sim
