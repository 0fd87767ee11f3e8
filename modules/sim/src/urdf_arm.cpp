// SPDX-License-Identifier: GPL-3.0-or-later
#include "urdf_arm.h"

#include <urdf_parser/urdf_parser.h>

#include <algorithm>
#include <limits>

#include "faults.h"
#include "servocal/core/error.h"

namespace servocal::sim {
namespace {

[[noreturn]] void refuse(const ArmConfig& arm, const std::string& what) {
  throw Error(ErrorKind::kInvalidConfig, "URDF '" + arm.urdf + "', simulated: " + what);
}

Eigen::Isometry3d toIsometry(const urdf::Pose& pose) {
  const urdf::Rotation& q = pose.rotation;
  Eigen::Isometry3d isometry = Eigen::Isometry3d::Identity();
  isometry.linear() = Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix();
  isometry.translation() << pose.position.x, pose.position.y, pose.position.z;
  return isometry;
}

}  // namespace

UrdfArm::UrdfArm(const ArmConfig& arm) {
  const urdf::ModelInterfaceSharedPtr model = urdf::parseURDFFile(arm.urdf);
  if (!model) refuse(arm, "cannot be read as a robot description.");
  name_ = model->getName();
  std::vector<urdf::JointConstSharedPtr> joints;
  urdf::LinkConstSharedPtr link = model->getLink(arm.flange_link);
  while (link && link->name != arm.base_link) {
    if (link->parent_joint) joints.push_back(link->parent_joint);
    link = link->getParent();
  }
  if (!link) refuse(arm, "has no chain from '" + arm.base_link + "' to '" + arm.flange_link + "'.");
  std::reverse(joints.begin(), joints.end());

  std::vector<double> lower, upper;
  Eigen::Isometry3d origin = Eigen::Isometry3d::Identity();
  for (const urdf::JointConstSharedPtr& joint : joints) {
    origin = origin * toIsometry(joint->parent_to_joint_origin_transform);
    if (joint->type == urdf::Joint::FIXED) continue;
    const bool free = joint->type == urdf::Joint::CONTINUOUS;
    if (!free && (joint->type != urdf::Joint::REVOLUTE || !joint->limits)) {
      refuse(arm, "joint '" + joint->name + "' must be fixed, continuous, or revolute with limits.");
    }
    origins_.push_back(origin);
    axes_.push_back(Eigen::Vector3d(joint->axis.x, joint->axis.y, joint->axis.z).normalized());
    lower.push_back(free ? -std::numeric_limits<double>::infinity() : joint->limits->lower);
    upper.push_back(free ? std::numeric_limits<double>::infinity() : joint->limits->upper);
    origin.setIdentity();
  }
  origins_.push_back(origin);
  if (axes_.empty() || axes_.size() > kMostJoints) {
    refuse(arm, "has " + std::to_string(axes_.size()) + " joints that turn; 1 to " +
                    std::to_string(kMostJoints) + " can be simulated.");
  }
  lower_ = Eigen::Map<Eigen::VectorXd>(lower.data(), static_cast<Eigen::Index>(lower.size()));
  upper_ = Eigen::Map<Eigen::VectorXd>(upper.data(), static_cast<Eigen::Index>(upper.size()));
}

std::vector<Eigen::Isometry3d> UrdfArm::frames(const Joints& q) const {
  std::vector<Eigen::Isometry3d> frames = {Eigen::Isometry3d::Identity()};
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    Eigen::Isometry3d frame = frames.back() * origins_[i];
    frame.linear() = frame.linear() * Eigen::AngleAxisd(q[static_cast<Eigen::Index>(i)], axes_[i]);
    frames.push_back(frame);
  }
  frames.push_back(frames.back() * origins_.back());
  return frames;
}

ArmJacobian UrdfArm::jacobian(const Joints& q) const {
  const std::vector<Eigen::Isometry3d> frame = frames(q);
  const Eigen::Vector3d flange = frame.back().translation();
  ArmJacobian jacobian(6, joints());
  for (int i = 0; i < joints(); ++i) {
    const Eigen::Isometry3d& turned =
        frame[static_cast<std::size_t>(i) + 1];  // Its axis does not turn with it.
    const Eigen::Vector3d axis = turned.linear() * axes_[static_cast<std::size_t>(i)];
    jacobian.col(i) << axis.cross(flange - turned.translation()), axis;
  }
  return jacobian;
}

std::unique_ptr<ArmChain> UrdfArm::perturbed(Random& random, double rms_error_m,
                                             const std::vector<Joints>& configurations) const {
  struct Unit {
    Eigen::Vector3d shift, turn;
  };
  const auto draw = [&](double sigma) {
    const double x = random.normal(), y = random.normal();
    return Eigen::Vector3d(sigma * x, sigma * y, sigma * random.normal());
  };
  std::vector<Unit> units;
  // Lengths and angles weigh alike at about half a metre from the axis.
  for (std::size_t i = 0; i < origins_.size(); ++i) {
    const Eigen::Vector3d shift = draw(1e-4);
    units.push_back({shift, draw(2e-4)});
  }
  double scale = 1.0;
  auto arm = std::make_unique<UrdfArm>(*this);
  for (int iteration = 0; iteration < 4; ++iteration) {  // The error is almost linear in the scale.
    for (std::size_t i = 0; i < origins_.size(); ++i) {
      const Eigen::Vector3d turn = scale * units[i].turn;
      arm->origins_[i] = origins_[i];
      arm->origins_[i].translation() += scale * units[i].shift;
      arm->origins_[i].linear() = origins_[i].linear() * rotation(turn);
    }
    double sum = 0.0;
    for (const Joints& q : configurations) {
      sum += (arm->forward(q).translation() - forward(q).translation()).squaredNorm();
    }
    const double rms = std::sqrt(sum / static_cast<double>(configurations.size()));
    if (iteration < 3 && rms > 0.0) scale *= rms_error_m / rms;
  }
  return arm;
}

}  // namespace servocal::sim
