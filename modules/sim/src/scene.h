// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "arm_silhouette.h"
#include "servocal/core/cell_config.h"
#include "moving_arm.h"
#include "stepped_pose.h"

namespace servocal::sim {

/// What the cameras look at: the arm, and the board on its flange or fixed in the cell.
class Scene {
 public:
  /// @throws std::invalid_argument if cameras are both fixed and on the flange, or on the flange while the
  ///   simulation does not say where the board is.
  Scene(MovingArm& arm, const CellConfig& config, std::uint64_t seed);

  const CellConfig& config() const { return config_; }
  const SimulationConfig& simulation() const { return *config_.simulation; }
  bool boardOnFlange() const { return board_on_flange_; }
  /// eMo, or bMo if the board is fixed.
  const SteppedPose& mount() const { return mount_; }

  /// cMo of a camera whose own pose (bMc, or eMc on the flange) is `camera`, at an instant of the last
  /// seconds.
  Eigen::Isometry3d cMo(const SteppedPose& camera, Instant instant) const;
  /// The arm's links and the board's holder in that camera's frame, thickness and gray of a UR5's.
  std::vector<Capsule> armLinks(const SteppedPose& camera, Instant instant) const;

 private:
  CellConfig config_;
  MovingArm& arm_;
  bool board_on_flange_;
  SteppedPose mount_;
};

}  // namespace servocal::sim
