// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot/kinematics.h"

#include <algorithm>
#include <cmath>
#include <kdl/chain.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "urdf_chain.h"

namespace servocal::robot {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kReachedM = 1e-4;
constexpr double kReachedRad = 1e-4;
constexpr double kNearRad = 1.0;  // A solution with every joint this near the seed is not searched on.
constexpr int kRestarts = 30;
constexpr int kEnoughRestarts = 6;  // Once there is a solution, for one nearer to the seed.

KDL::Frame toKdl(const urdf::Pose& pose) {
  return {KDL::Rotation::Quaternion(pose.rotation.x, pose.rotation.y, pose.rotation.z, pose.rotation.w),
          KDL::Vector(pose.position.x, pose.position.y, pose.position.z)};
}

KDL::Frame toKdl(const Pose<Base, EndEffector>& pose) {
  KDL::Frame frame;
  const Eigen::Matrix3d rotation = pose.rotation();
  const Eigen::Vector3d translation = pose.translation();
  for (int row = 0; row < 3; ++row) {
    frame.p[row] = translation[row];
    for (int column = 0; column < 3; ++column) frame.M(row, column) = rotation(row, column);
  }
  return frame;
}

Pose<Base, EndEffector> fromKdl(const KDL::Frame& frame) {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
  for (int row = 0; row < 3; ++row) {
    translation[row] = frame.p[row];
    for (int column = 0; column < 3; ++column) rotation(row, column) = frame.M(row, column);
  }
  return {rotation, translation};
}

KDL::JntArray toKdl(const Eigen::VectorXd& q) {
  KDL::JntArray joints(static_cast<unsigned>(q.size()));
  joints.data = q;
  return joints;
}

KDL::Frame zTo(const urdf::Vector3& axis) {
  const auto turn = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), Eigen::Vector3d(axis.x, axis.y, axis.z));
  return KDL::Frame(KDL::Rotation::Quaternion(turn.x(), turn.y(), turn.z(), turn.w()));
}

// Every joint turns about the z of a frame laid along its axis. KDL's joint about any axis would spare
// that frame, but it keeps its last pose in mutable members, which threads that share a chain corrupt.
KDL::Chain toKdl(const std::vector<urdf::JointSharedPtr>& joints) {
  KDL::Chain chain;
  KDL::Joint joint("base", KDL::Joint::None);
  KDL::Frame tip;  // Of the segment that `joint` moves: all that is fixed up to the next joint.
  for (const urdf::JointSharedPtr& next : joints) {
    tip = tip * toKdl(next->parent_to_joint_origin_transform);
    if (next->type == urdf::Joint::FIXED) continue;
    const KDL::Frame along_axis = zTo(next->axis);
    chain.addSegment(KDL::Segment(joint.getName(), joint, tip * along_axis));
    joint = KDL::Joint(next->name, KDL::Joint::RotZ);
    tip = along_axis.Inverse();
  }
  chain.addSegment(KDL::Segment(joint.getName(), joint, tip));
  return chain;
}

}  // namespace

struct Kinematics::Impl {
  KDL::Chain chain;
  Eigen::VectorXd lower;
  Eigen::VectorXd upper;
  double reach_m = 0.0;  // No flange pose is farther from the base than this.

  void checkSize(const Eigen::VectorXd& q) const {
    if (q.size() != lower.size())
      throw std::invalid_argument("expected " + std::to_string(lower.size()) + " joint angles, got " +
                                  std::to_string(q.size()));
  }

  Pose<Base, EndEffector> forward(const KDL::JntArray& q) const {
    KDL::ChainFkSolverPos_recursive solver(chain);  // Holds scratch memory, so one per call.
    KDL::Frame frame;
    solver.JntToCart(q, frame);
    return fromKdl(frame);
  }

  // Moves every angle by whole turns, to the one nearest the seed inside the limits. False if a joint
  // has none.
  bool wrapToSeed(Eigen::VectorXd& q, const Eigen::VectorXd& seed, double margin_rad) const {
    for (Eigen::Index joint = 0; joint < q.size(); ++joint) {
      const double low = lower[joint] + margin_rad, high = upper[joint] - margin_rad;
      double angle = q[joint] + 2.0 * kPi * std::round((seed[joint] - q[joint]) / (2.0 * kPi));
      if (angle < low) angle += 2.0 * kPi * std::ceil((low - angle) / (2.0 * kPi));
      if (angle > high) angle -= 2.0 * kPi * std::ceil((angle - high) / (2.0 * kPi));
      if (!(angle >= low && angle <= high)) return false;
      q[joint] = angle;
    }
    return true;
  }
};

Kinematics::Kinematics(const ArmConfig& arm) : impl_(std::make_unique<Impl>()) {
  const UrdfChain chain = readChain(arm);
  impl_->chain = toKdl(chain.joints);
  std::vector<double> lower, upper;
  for (const urdf::JointSharedPtr& joint : chain.joints) {
    impl_->reach_m += toKdl(joint->parent_to_joint_origin_transform).p.Norm();
    if (joint->type == urdf::Joint::FIXED) continue;
    const bool continuous = joint->type == urdf::Joint::CONTINUOUS;
    lower.push_back(continuous ? -std::numeric_limits<double>::infinity() : joint->limits->lower);
    upper.push_back(continuous ? std::numeric_limits<double>::infinity() : joint->limits->upper);
  }
  impl_->lower = Eigen::Map<Eigen::VectorXd>(lower.data(), static_cast<Eigen::Index>(lower.size()));
  impl_->upper = Eigen::Map<Eigen::VectorXd>(upper.data(), static_cast<Eigen::Index>(upper.size()));
}

Kinematics::~Kinematics() = default;
Kinematics::Kinematics(Kinematics&&) noexcept = default;

int Kinematics::joints() const { return static_cast<int>(impl_->lower.size()); }
const Eigen::VectorXd& Kinematics::lower() const { return impl_->lower; }
const Eigen::VectorXd& Kinematics::upper() const { return impl_->upper; }

Pose<Base, EndEffector> Kinematics::forward(const Eigen::VectorXd& q) const {
  impl_->checkSize(q);
  return impl_->forward(toKdl(q));
}

Eigen::MatrixXd Kinematics::jacobian(const Eigen::VectorXd& q) const {
  impl_->checkSize(q);
  KDL::ChainJntToJacSolver solver(impl_->chain);
  KDL::Jacobian jacobian(static_cast<unsigned>(q.size()));
  solver.JntToJac(toKdl(q), jacobian);
  return jacobian.data;
}

std::optional<Eigen::VectorXd> Kinematics::inverse(const Pose<Base, EndEffector>& bMe,
                                                   const Eigen::VectorXd& seed,
                                                   double margin_rad) const {
  impl_->checkSize(seed);
  if (!bMe.isFinite() || !seed.allFinite())
    throw std::invalid_argument("inverse kinematics of a pose or seed that is not finite");
  if (bMe.translation().norm() > impl_->reach_m + kReachedM) return std::nullopt;

  // Metres and 0.3 x radians count alike; KDL's default weight would leave a milliradian.
  Eigen::Matrix<double, 6, 1> weights;
  weights << 1.0, 1.0, 1.0, 0.3, 0.3, 0.3;
  KDL::ChainIkSolverPos_LMA solver(impl_->chain, weights, 1e-7, 60, 1e-14);
  const KDL::Frame goal = toKdl(bMe);

  std::optional<Eigen::VectorXd> best;
  double best_distance = std::numeric_limits<double>::infinity();
  std::mt19937_64 random(1);  // The same every time: a run must be repeatable.
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int attempt = 0; attempt <= kRestarts; ++attempt) {
    Eigen::VectorXd start = seed;
    if (attempt > 0) {
      // Around the seed first, then anywhere.
      const double half_range = std::min(kPi, 0.5 + 0.15 * attempt);
      for (double& angle : start) angle += half_range * uniform(random);
    }
    KDL::JntArray found(static_cast<unsigned>(seed.size()));
    solver.CartToJnt(toKdl(start), goal, found);
    // LMA's return code is about its own steps; what counts is where the arm would be.
    Eigen::VectorXd q = found.data;
    if (!q.allFinite() || !impl_->wrapToSeed(q, seed, margin_rad)) continue;
    const Pose<Base, EndEffector> reached = impl_->forward(toKdl(q));
    if (distanceM(reached, bMe) > kReachedM || angleRad(reached, bMe) > kReachedRad) continue;
    const double distance = (q - seed).cwiseAbs().maxCoeff();
    if (distance < best_distance) {
      best = q;
      best_distance = distance;
    }
    if (best_distance < kNearRad) break;
    if (attempt >= kEnoughRestarts) break;
  }
  return best;
}

}  // namespace servocal::robot
