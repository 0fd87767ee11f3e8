// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_arm.h"

#include <Eigen/Geometry>
#include <Eigen/QR>
#include <cmath>
#include <memory>
#include <string>

#include "servocal/robot/kinematics.h"

namespace servocal::procedure {
namespace {

constexpr double kLeverM = 0.5;     // Makes an accuracy in rad of one in m.
constexpr double kParallel = 0.05;  // sine of the angle between two axes

/// A joint's axis in the base, with a point of it that stays where it is in the links on either side.
struct Axis {
  Eigen::Vector3d direction;
  Eigen::Vector3d point;
};

/// The common normal of an axis and the one before: Denavit and Hartenberg's x.
struct Normal {
  Eigen::Vector3d direction;
  Eigen::Vector3d foot;  // on the axis before
  bool parallel = false;
};

struct Chain {
  std::vector<Axis> axes;
  std::vector<Normal> normals;  // from axis i to axis i + 1
  Pose<Base, EndEffector> bMe;
};

Eigen::Vector3d nearestOn(const Axis& axis, const Eigen::Vector3d& point) {
  return axis.point + axis.direction * axis.direction.dot(point - axis.point);
}

/// From `before`, whose point is settled already, to `axis`, whose point becomes the foot of the normal.
Normal normalBetween(const Axis& before, Axis& axis) {
  Normal normal;
  const Eigen::Vector3d across = before.direction.cross(axis.direction);
  normal.parallel = across.norm() < kParallel;
  if (normal.parallel) {
    normal.foot = before.point;
    axis.point = nearestOn(axis, normal.foot);
    normal.direction = (axis.point - normal.foot).stableNormalized();
    return normal;
  }
  normal.direction = across.normalized();
  // The point of the axis before that is nearest to the axis: apart + s before - t axis is along the normal.
  const Eigen::Vector3d apart = axis.point - before.point;
  const Eigen::Vector3d of_axis = axis.direction.cross(across);
  normal.foot = before.point + before.direction * (apart.dot(of_axis) / before.direction.dot(of_axis));
  axis.point = nearestOn(axis, normal.foot);
  return normal;
}

Chain chainAt(const robot::Kinematics& kinematics, const Eigen::VectorXd& q) {
  Chain chain;
  chain.bMe = kinematics.forward(q);
  const Eigen::MatrixXd jacobian = kinematics.jacobian(q);
  for (Eigen::Index i = 0; i < jacobian.cols(); ++i) {
    const Eigen::Vector3d direction = jacobian.col(i).tail<3>(), velocity = jacobian.col(i).head<3>();
    chain.axes.push_back({direction, chain.bMe.translation() + direction.cross(velocity)});
  }
  chain.axes.front().point = nearestOn(chain.axes.front(), Eigen::Vector3d::Zero());
  for (std::size_t i = 0; i + 1 < chain.axes.size(); ++i) {
    chain.normals.push_back(normalBetween(chain.axes[i], chain.axes[i + 1]));
  }
  return chain;
}

/// Terms, each with its column: how the flange moves in the base.
struct Columns {
  explicit Columns(double accuracy) : accuracy_m(accuracy) {}

  double accuracy_m;
  std::vector<std::string> names;
  std::vector<double> prior_sigma;
  std::vector<Eigen::Matrix<double, 6, 1>> motions;

  void shift(const std::string& name, const Eigen::Vector3d& direction) {
    names.push_back(name + " (m)");
    prior_sigma.push_back(accuracy_m);
    motions.emplace_back();
    motions.back() << direction, Eigen::Vector3d::Zero();
  }
  void turn(const std::string& name, const Eigen::Vector3d& axis, const Eigen::Vector3d& lever) {
    names.push_back(name + " (rad)");
    prior_sigma.push_back(accuracy_m / kLeverM);
    motions.emplace_back();
    motions.back() << axis.cross(lever), axis;
  }
};

Columns columnsOf(const Chain& chain, double accuracy_m) {
  Columns columns(accuracy_m);
  const Eigen::Vector3d flange = chain.bMe.translation();
  for (std::size_t i = 0; i < chain.normals.size(); ++i) {
    const Normal& normal = chain.normals[i];
    const Axis& axis = chain.axes[i];
    const std::string joint = "joint " + std::to_string(i + 1), link = "link " + std::to_string(i + 1);
    // What the first and the last joint have is in the pose of the base and of what the flange holds.
    if (i > 0) {
      columns.turn(joint + " offset", axis.direction, flange - axis.point);
      if (normal.parallel) {
        columns.turn(link + " tilt", axis.direction.cross(normal.direction), flange - normal.foot);
      } else {
        columns.shift(link + " offset", axis.direction);
      }
    }
    columns.shift(link + " length", normal.direction);
    columns.turn(link + " twist", normal.direction, flange - normal.foot);
  }
  return columns;
}

/// By how much the priors have to shrink for all terms together to move the flange by the accuracy, RMS per axis, at these
/// stops. What another pose of the base or of what the flange holds would do does not count: those are free. At most 1.
double priorScale(const calib::RobotTerms& terms, const std::vector<Observation>& stops, double accuracy_m) {
  std::vector<const RobotState*> states;
  for (const Observation& stop : stops) {
    if (stop.robot) states.push_back(&*stop.robot);
  }
  const auto count = static_cast<Eigen::Index>(terms.names.size()), rows = static_cast<Eigen::Index>(3 * states.size());
  constexpr Eigen::Index kPoses = 9;
  if (rows <= kPoses) return 1.0;
  Eigen::MatrixXd moved(rows, count), by_poses(rows, kPoses);
  for (std::size_t i = 0; i < states.size(); ++i) {
    const Pose<Base, EndEffector>& bMe = states[i]->bMe;
    const Eigen::Matrix3d eRb = bMe.rotation().transpose();
    const Eigen::Vector3d at_e = eRb * bMe.translation();
    const auto row = static_cast<Eigen::Index>(3 * i);
    moved.middleRows<3>(row) = terms.jacobian(*states[i]).topRows<3>() * terms.prior_sigma.asDiagonal();
    Eigen::Matrix<double, 3, kPoses> poses = Eigen::Matrix<double, 3, kPoses>::Zero();
    poses.leftCols<3>() = eRb;  // of the base: displacement, turn
    for (int axis = 0; axis < 3; ++axis) poses.col(3 + axis) = eRb.col(axis).cross(at_e);
    poses.rightCols<3>() = Eigen::Matrix3d::Identity();  // of what the flange holds: a turn moves no origin
    by_poses.middleRows<3>(row) = poses;
  }
  const Eigen::MatrixXd left = moved - by_poses * by_poses.completeOrthogonalDecomposition().solve(moved);
  const double rms_m = std::sqrt(left.squaredNorm() / static_cast<double>(rows));
  return rms_m > accuracy_m ? accuracy_m / rms_m : 1.0;
}

}  // namespace

std::optional<calib::RobotTerms> armTerms(const ArmConfig& arm, const std::vector<Observation>& stops) {
  const auto kinematics = std::make_shared<const robot::Kinematics>(arm);
  if (kinematics->joints() < 2) return std::nullopt;
  const Columns columns =
      columnsOf(chainAt(*kinematics, Eigen::VectorXd::Zero(kinematics->joints())), arm.accuracy_m);
  calib::RobotTerms terms;
  terms.names = columns.names;
  terms.prior_sigma = Eigen::Map<const Eigen::VectorXd>(
      columns.prior_sigma.data(), static_cast<Eigen::Index>(columns.prior_sigma.size()));
  terms.jacobian = [kinematics, accuracy_m = arm.accuracy_m](const RobotState& state) {
    const Chain chain = chainAt(*kinematics, state.q);
    const Columns at = columnsOf(chain, accuracy_m);
    const Eigen::Matrix3d eRb = chain.bMe.rotation().transpose();
    Eigen::MatrixXd jacobian(6, static_cast<Eigen::Index>(at.motions.size()));
    for (std::size_t i = 0; i < at.motions.size(); ++i) {
      jacobian.col(static_cast<Eigen::Index>(i)) << eRb * at.motions[i].head<3>(),
          eRb * at.motions[i].tail<3>();
    }
    return jacobian;
  };
  terms.prior_sigma *= priorScale(terms, stops, arm.accuracy_m);
  return terms;
}

}  // namespace servocal::procedure
