// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

namespace servocal {

/// Frame tags, ViSP's letters. `aMb` is the pose of b in a and takes points of b to a.
struct Base {};         ///< b: robot base, as the robot's controller defines it.
struct EndEffector {};  ///< e: robot flange (tool frame of the controller).
struct Board {};        ///< o: calibration board; see BoardSpec for origin and axes.
struct Color {};        ///< c: color camera, x right, y down, z forward.
struct Infrared {};     ///< i: infrared and depth camera, axes as Color.

/// Rigid transform `aMb`, typed by its frames so that a forgotten inverse does not compile.
///
/// A default-constructed pose is not-a-number, never the identity: a pose that nobody set fails the
/// finiteness checks instead of quietly moving the arm somewhere.
template <class A, class B>
class Pose {
 public:
  Pose() { transform_.matrix().setConstant(std::numeric_limits<double>::quiet_NaN()); }
  explicit Pose(const Eigen::Isometry3d& aTb) : transform_(aTb) {}
  Pose(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& translation_m) {
    transform_.setIdentity();
    transform_.linear() = rotation;
    transform_.translation() = translation_m;
  }

  static Pose identity() { return Pose(Eigen::Isometry3d::Identity()); }
  /// Rotation vector: axis times angle, radians (ViSP's theta-u).
  static Pose fromRotationVector(const Eigen::Vector3d& rotation_rad,
                                 const Eigen::Vector3d& translation_m) {
    const double angle = rotation_rad.norm();
    const Eigen::Matrix3d rotation =
        angle > 0.0 ? Eigen::AngleAxisd(angle, rotation_rad / angle).toRotationMatrix()
                    : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
    return Pose(rotation, translation_m);
  }
  static Pose fromQuaternion(const Eigen::Quaterniond& q, const Eigen::Vector3d& translation_m) {
    return Pose(q.normalized().toRotationMatrix(), translation_m);
  }

  Eigen::Matrix3d rotation() const { return transform_.linear(); }
  Eigen::Vector3d translation() const { return transform_.translation(); }  ///< metres
  Eigen::Quaterniond quaternion() const { return Eigen::Quaterniond(rotation()); }
  Eigen::Vector3d rotationVector() const {
    const Eigen::AngleAxisd angle_axis(rotation());
    return angle_axis.angle() * angle_axis.axis();
  }
  const Eigen::Isometry3d& isometry() const { return transform_; }
  bool isFinite() const { return transform_.matrix().allFinite(); }

  Pose<B, A> inverse() const { return Pose<B, A>(transform_.inverse()); }
  template <class C>
  Pose<A, C> operator*(const Pose<B, C>& bMc) const {
    return Pose<A, C>(transform_ * bMc.isometry());
  }
  /// Takes a point (m) from frame b to frame a.
  Eigen::Vector3d operator*(const Eigen::Vector3d& point_b) const { return transform_ * point_b; }

 private:
  Eigen::Isometry3d transform_;
};

/// The same transform under other frame names; the one deliberate way around the frame types.
template <class C, class D, class A, class B>
Pose<C, D> relabel(const Pose<A, B>& aMb) {
  return Pose<C, D>(aMb.isometry());
}

/// Distance between the two origins of b, metres.
template <class A, class B>
double distanceM(const Pose<A, B>& first, const Pose<A, B>& second) {
  return (first.translation() - second.translation()).norm();
}

/// Angle of the rotation between two poses, radians in [0, pi]; exact for small angles too.
template <class A, class B>
double angleRad(const Pose<A, B>& first, const Pose<A, B>& second) {
  const Eigen::Quaterniond q(Eigen::Matrix3d(first.rotation().transpose() * second.rotation()));
  return 2.0 * std::atan2(q.vec().norm(), std::abs(q.w()));
}

/// Velocity of the end effector: of its origin (m/s) and its rotation rate (rad/s), both along the
/// axes of F, linear part first. Twist<Base> is what a UR's speedl takes.
template <class F>
struct Twist {
  Eigen::Vector3d linear_mps = Eigen::Vector3d::Zero();
  Eigen::Vector3d angular_radps = Eigen::Vector3d::Zero();

  bool isFinite() const { return linear_mps.allFinite() && angular_radps.allFinite(); }
  bool isZero() const { return linear_mps.isZero(0.0) && angular_radps.isZero(0.0); }
};

/// The same end-effector velocity along the base's axes.
inline Twist<Base> toBase(const Pose<Base, EndEffector>& bMe, const Twist<EndEffector>& twist) {
  return {bMe.rotation() * twist.linear_mps, bMe.rotation() * twist.angular_radps};
}

}  // namespace servocal
