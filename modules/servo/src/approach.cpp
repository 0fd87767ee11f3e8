// SPDX-License-Identifier: GPL-3.0-or-later
#include "approach.h"

#include <algorithm>
#include <cmath>

namespace servocal::servo {
namespace {

constexpr double kBrakingShare = 0.8;  // Of the acceleration limit; the rest is for corrections.
constexpr double kStepM = 0.03;        // Of a rehearsal.
constexpr double kStepRad = 0.1;
constexpr double kJumpRad = 0.8;       // Farther than this in one such step is another posture of the arm.

Eigen::Vector3d turnFromTo(const Pose<Base, EndEffector>& from, const Pose<Base, EndEffector>& to) {
  const Eigen::Matrix3d turn = to.rotation() * from.rotation().transpose();
  return Pose<Base, Base>(turn, Eigen::Vector3d::Zero()).rotationVector();
}

}  // namespace

double speedAt(double distance, double limit, double acceleration, double gain) {
  const double linear_zone = acceleration / (gain * gain);
  if (distance <= linear_zone) return std::min(limit, gain * distance);
  return std::min(limit, std::sqrt(2.0 * acceleration * (distance - 0.5 * linear_zone)));
}

double approachGain(double distance_m, double angle_rad, const MotionLimits& limits, double gain_per_s,
                    double share) {
  double gain = gain_per_s;
  if (distance_m > 0.0)
    gain = std::min(gain, speedAt(distance_m, share * limits.max_speed_mps,
                                  kBrakingShare * limits.max_acceleration_mps2, gain_per_s) /
                              distance_m);
  if (angle_rad > 0.0)
    gain = std::min(gain, speedAt(angle_rad, share * limits.max_angular_speed_radps,
                                  kBrakingShare * limits.max_angular_acceleration_radps2, gain_per_s) /
                              angle_rad);
  return gain;
}

Twist<Base> approach(const Pose<Base, EndEffector>& from, const Pose<Base, EndEffector>& to,
                     const MotionLimits& limits, double gain_per_s, double share) {
  const Eigen::Vector3d way = to.translation() - from.translation();
  const Eigen::Vector3d turn = turnFromTo(from, to);
  const double gain = approachGain(way.norm(), turn.norm(), limits, gain_per_s, share);
  return {gain * way, gain * turn};
}

std::optional<WayObjection> rehearse(const robot::Guard& guard, const RobotState& from,
                                     const Pose<Base, EndEffector>& to) {
  const double margin = guard.limits().joint_margin_rad;
  if (auto reason = guard.objection(to)) return WayObjection{true, *reason};
  if (!guard.kinematics().inverse(to, from.q, margin))
    return WayObjection{true, "No joint angles of the arm reach the goal."};

  const Eigen::Vector3d way = to.translation() - from.bMe.translation();
  const Eigen::Vector3d turn = turnFromTo(from.bMe, to);
  const int steps = std::max(1, static_cast<int>(std::ceil(std::max(way.norm() / kStepM, turn.norm() / kStepRad))));
  Eigen::VectorXd q = from.q;
  bool was_free = guard.allows(from.bMe);  // An arm that starts in a box may leave it.
  bool links_were_free = guard.allows(from.q);
  for (int step = 1; step <= steps; ++step) {
    const double share = static_cast<double>(step) / steps;
    const auto rotation = Pose<Base, Base>::fromRotationVector(share * turn, Eigen::Vector3d::Zero());
    const Pose<Base, EndEffector> bMe(rotation.rotation() * from.bMe.rotation(),
                                      from.bMe.translation() + share * way);
    const std::optional<std::string> reason = guard.objection(bMe);
    if (reason && was_free) return WayObjection{false, *reason};
    was_free = was_free || !reason;
    const std::optional<Eigen::VectorXd> next = guard.kinematics().inverse(bMe, q);
    // Near a singular pose this test is too rough to say no; the guard will if it must.
    if (!next || (*next - q).cwiseAbs().maxCoeff() > kJumpRad) return std::nullopt;
    q = *next;
    for (Eigen::Index joint = 0; joint < q.size(); ++joint)
      if (q[joint] < guard.kinematics().lower()[joint] + margin ||
          q[joint] > guard.kinematics().upper()[joint] - margin)
        return WayObjection{false, "The straight way to the goal leads joint " +
                                       std::to_string(joint + 1) + " into its limit."};
    const std::optional<std::string> contact = guard.objection(q);  // Of the links: the rest is known.
    if (contact && links_were_free) return WayObjection{step == steps, *contact};
    links_were_free = links_were_free || !contact;
  }
  return std::nullopt;
}

}  // namespace servocal::servo
