// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>

#include "servocal/core/observation.h"
#include "twist_limits.h"

namespace servocal::robot {

/// A velocity as an arm takes it: a twist of the end effector (base axes, linear part first), or the speeds
/// of its joints (rad/s).
struct Motion {
  enum class Kind { kTwist, kJoints };
  Kind kind = Kind::kTwist;
  Eigen::VectorXd velocity;

  bool isZero() const { return velocity.isZero(0.0); }
  Motion scaled(double factor) const { return {kind, factor * velocity}; }
};

/// Motions at one configuration of the arm.
class MotionAt {
 public:
  explicit MotionAt(Eigen::MatrixXd jacobian) : jacobian_(std::move(jacobian)) {}
  const Eigen::MatrixXd& jacobian() const { return jacobian_; }

  Twist<Base> twist(const Motion& motion) const {
    const Eigen::VectorXd v =
        motion.kind == Motion::Kind::kTwist ? motion.velocity : jacobian_ * motion.velocity;
    return {v.head<3>(), v.tail<3>()};
  }
  /// Infinite where the arm cannot make the twist, that is at a singular pose.
  Eigen::VectorXd joints(const Motion& motion) const {
    return motion.kind == Motion::Kind::kJoints ? motion.velocity : jointSpeeds(jacobian_, twist(motion));
  }
  double smallestSingularValue() const { return robot::smallestSingularValue(jacobian_); }
  /// How many times faster the joints may have to turn for a twist where none is farther off than `reach_rad`:
  /// as fast as the smallest singular value may be smaller there. Infinite if it may be none.
  double speedMargin(const Motion& motion, double reach_rad) const {
    if (motion.kind == Motion::Kind::kJoints || reach_rad == 0.0) return 1.0;
    const double singularity = smallestSingularValue();
    return singularity > reach_rad ? singularity / (singularity - reach_rad)
                                   : std::numeric_limits<double>::infinity();
  }
  /// Seconds of full braking that take the motion to rest while it keeps its direction. A joint alone
  /// accelerates no faster than it may turn the flange.
  double brakingTime(const Motion& motion, const MotionLimits& limits) const {
    const double time = robot::brakingTime(twist(motion), limits);
    if (motion.kind == Motion::Kind::kTwist || motion.velocity.size() == 0) return time;
    return std::max(time, motion.velocity.cwiseAbs().maxCoeff() / limits.max_angular_acceleration_radps2);
  }

 private:
  Eigen::MatrixXd jacobian_;
};

}  // namespace servocal::robot
