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

/// The truth of a simulated cell. It must not outlive the cell.
class Truth {
 public:
  explicit Truth(Cell& cell);

  /// True intrinsics; OpenCV's model and order (plumb bob).
  CameraModel camera(const std::string& name) const;
  Pose<Base, Color> bMc(const std::string& camera) const;
  Pose<EndEffector, Board> eMo() const;

  /// Where the flange really is, now or at an instant of the last two seconds. What the arm reports
  /// differs by its kinematic errors and its repeatability.
  Pose<Base, EndEffector> bMe() const;
  Pose<Base, EndEffector> bMe(Instant instant) const;
  /// Joint angles without encoder noise.
  Eigen::VectorXd q() const;
  Eigen::VectorXd q(Instant instant) const;

  Pose<Color, Board> cMo(const std::string& camera, Instant instant) const;
  /// True pixels of the board's corners by id at an instant, e.g. a frame's stamp; may lie outside.
  std::vector<Eigen::Vector2d> corners(const std::string& camera, Instant instant) const;

  std::int64_t framesRendered(const std::string& camera) const;

 private:
  Cell::Impl* impl_;
};

}  // namespace servocal::sim
