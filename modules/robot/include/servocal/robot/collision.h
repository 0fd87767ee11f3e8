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

/// A ball in the robot base that nothing of the arm may enter, e.g. the space around a camera.
struct Sphere {
  std::string name;
  Eigen::Vector3d center_b = Eigen::Vector3d::Zero();  ///< m
  double radius_m = 0.2;
};

/// What touches what when the arm stands at given joint angles: its links, the board on its flange, the
/// cell's keep-out boxes and obstacles. Nominal kinematics; a few microseconds per question.
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

  /// Balls that links and board must not touch, instead of those set before.
  /// @throws std::invalid_argument if a center is not finite or a radius not positive.
  void setObstacles(const std::vector<Sphere>& obstacles);

  /// A sentence naming the two bodies that touch; nothing if none do.
  /// @throws std::invalid_argument unless q has one finite angle per joint; the same below.
  std::optional<std::string> contact(const Eigen::VectorXd& q) const;
  /// Smallest distance of any two bodies that must not touch, m; zero if they do.
  double clearance(const Eigen::VectorXd& q) const;

  /// Two bodies that must not touch.
  struct Gap {
    double distance_m = 0.0;  ///< Exact from zero to 0.1 m; beyond a lower bound. Negative: how deep they overlap.
    const char* a = "";       ///< Their names; valid until the model is changed.
    const char* b = "";
  };
  /// All pairs, always in the same order, by closed forms instead of FCL: for questions on every command.
  std::vector<Gap> gaps(const Eigen::VectorXd& q) const;
  /// No point of links or board moves farther than this against another when the joints turn by dq (rad), m.
  double travel(const Eigen::VectorXd& dq) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::robot
