// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"

namespace servocal::robot {

/// What touches what when the arm stands at given joint angles: its links, the board on its flange, and the
/// cell's keep-out boxes. Nominal kinematics; a few microseconds per question.
///
/// Links take the collision shapes of the URDF (boxes, spheres, and cylinders as capsules, a little longer); a
/// link without any, or with meshes, is a capsule of 60 mm radius from its joint to the next. Links less than
/// three joints apart never count as touching, nor does the board and the last three links. A box that always
/// holds the place a link hangs on (the arm's own base) is not forbidden to that link.
class CollisionModel {
 public:
  /// @throws Error (kInvalidConfig) as Kinematics.
  CollisionModel(const ArmConfig& arm, const std::vector<Box>& keep_out, const BoardSpec& board);
  ~CollisionModel();
  CollisionModel(CollisionModel&&) noexcept;

  /// Where the board sits on the flange; nothing if it is not on the arm. The plate counts as 10 mm thick.
  void setBoard(const std::optional<Pose<EndEffector, Board>>& eMo);

  /// A sentence naming the two bodies that touch; nothing if none do.
  /// @throws std::invalid_argument unless q has one finite angle per joint; the same below.
  std::optional<std::string> contact(const Eigen::VectorXd& q) const;
  /// Smallest distance of any two bodies that must not touch, m; zero if they do.
  double clearance(const Eigen::VectorXd& q) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::robot
