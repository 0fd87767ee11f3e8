// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <cstdint>

#include "ur5.h"

namespace servocal::sim {

/// A UR5 under the controller's motion functions, a step of time at a time. Its lengths are off the nominal
/// ones as a real arm's are; the controller knows the real ones (its calibration).
class ArmModel {
 public:
  ArmModel(const Vector6d& q, const Eigen::Isometry3d& tcp_offset, std::uint64_t seed, double error_m);

  void speedl(const Vector6d& tcp_twist, double acceleration, double angular_acceleration);
  void speedj(const Vector6d& speeds, double acceleration);
  void stopl(double acceleration, double angular_acceleration);
  void stopj(double acceleration);
  /// `share`: the speed slider, 0 to 1.
  void step(double dt, double share);

  const Vector6d& q() const { return q_; }
  const Vector6d& speeds() const { return speeds_; }
  bool stands() const { return speeds_.cwiseAbs().maxCoeff() < 1e-6; }
  /// A joint ran faster or farther than the arm allows; the controller makes a protective stop of it.
  bool overran() const { return overran_; }
  Eigen::Isometry3d flange() const { return kinematics_.forward(q_); }
  Eigen::Isometry3d tcp() const { return flange() * tcp_offset_; }
  /// Of the TCP, along the base's axes, linear part first.
  Vector6d tcpSpeed() const { return tcpJacobian(q_) * speeds_; }

 private:
  enum class Mode { kTwist, kJoints };

  Matrix6d tcpJacobian(const Vector6d& q) const;

  Ur5 kinematics_;
  Eigen::Isometry3d tcp_offset_;
  Vector6d q_;
  Vector6d speeds_ = Vector6d::Zero();
  Mode mode_ = Mode::kJoints;
  Vector6d target_ = Vector6d::Zero();   ///< TCP twist or joint speeds.
  Vector6d current_ = Vector6d::Zero();  ///< The same, ramped.
  double acceleration_ = 5.0;
  double angular_acceleration_ = 5.0;
  bool overran_ = false;
};

}  // namespace servocal::sim
