// SPDX-License-Identifier: GPL-3.0-or-later
#include "arm_model.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace servocal::sim {
namespace {

constexpr double kMaxJointSpeedRadps = 3.2;
constexpr double kSingularBelow = 1e-4;  // |det J|

Ur5 realArm(std::uint64_t seed, double error_m) {
  Random random(seed, "ur controller");
  std::vector<Vector6d> configurations(100);
  for (Vector6d& q : configurations)
    for (double& angle : q) angle = random.uniform(-M_PI, M_PI);
  return Ur5::perturbed(random, error_m, configurations);
}

// `from` moved towards `to` by at most `most`, each vector as a whole.
template <class Part>
void approach(Part&& from, const Eigen::Vector3d& to, double most) {
  const Eigen::Vector3d change = to - from;
  const double length = change.norm();
  from += length > most ? Eigen::Vector3d(change * (most / length)) : change;
}

}  // namespace

ArmModel::ArmModel(const Vector6d& q, const Eigen::Isometry3d& tcp_offset, std::uint64_t seed, double error_m)
    : kinematics_(realArm(seed, error_m)), tcp_offset_(tcp_offset), q_(q) {}

Matrix6d ArmModel::tcpJacobian(const Vector6d& q) const {
  Matrix6d jacobian = kinematics_.jacobian(q);
  const Eigen::Vector3d lever = kinematics_.forward(q).linear() * tcp_offset_.translation();
  for (int joint = 0; joint < 6; ++joint) {
    const Eigen::Vector3d axis = jacobian.col(joint).tail<3>();
    jacobian.col(joint).head<3>() += axis.cross(lever);
  }
  return jacobian;
}

void ArmModel::speedl(const Vector6d& tcp_twist, double acceleration, double angular_acceleration) {
  if (mode_ != Mode::kTwist) current_ = tcpSpeed();
  mode_ = Mode::kTwist;
  target_ = tcp_twist;
  acceleration_ = acceleration;
  angular_acceleration_ = angular_acceleration;
}

void ArmModel::speedj(const Vector6d& speeds, double acceleration) {
  if (mode_ != Mode::kJoints) current_ = speeds_;
  mode_ = Mode::kJoints;
  target_ = speeds;
  acceleration_ = acceleration;
}

void ArmModel::stopl(double acceleration, double angular_acceleration) {
  speedl(Vector6d::Zero(), acceleration, angular_acceleration);
}

void ArmModel::stopj(double acceleration) { speedj(Vector6d::Zero(), acceleration); }

void ArmModel::step(double dt, double share) {
  Vector6d speeds;
  if (mode_ == Mode::kTwist) {
    approach(current_.head<3>(), target_.head<3>(), acceleration_ * dt);
    approach(current_.tail<3>(), target_.tail<3>(), angular_acceleration_ * dt);
    const Vector6d twist = share * current_;
    const auto jointsFor = [&](const Vector6d& q) -> Vector6d {
      const Matrix6d jacobian = tcpJacobian(q);
      if (std::abs(jacobian.determinant()) < kSingularBelow && !twist.isZero()) overran_ = true;
      return jacobian.partialPivLu().solve(twist);
    };
    speeds = twist.isZero() ? Vector6d::Zero() : jointsFor(q_ + 0.5 * dt * jointsFor(q_));
  } else {
    const Vector6d change = target_ - current_;
    const double largest = change.cwiseAbs().maxCoeff(), most = acceleration_ * dt;
    current_ += largest > most ? Vector6d(change * (most / largest)) : change;
    speeds = share * current_;
  }
  if (!speeds.allFinite() || speeds.cwiseAbs().maxCoeff() > kMaxJointSpeedRadps) {
    overran_ = true;
    speeds.setZero();
    current_.setZero();
  }
  speeds_ = speeds;
  q_ += dt * speeds_;
  if (q_.cwiseAbs().maxCoeff() > Ur5::kJointLimitRad) overran_ = true;
}

}  // namespace servocal::sim
