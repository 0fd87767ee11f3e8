// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot/collision.h"

#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/collision.h>
#include <fcl/narrowphase/distance.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <random>
#include <stdexcept>

#include "shape_gap.h"
#include "urdf_chain.h"

namespace servocal::robot {
namespace {

constexpr double kLinkRadiusM = 0.06;      // Of a link whose shape is not known.
constexpr double kBoardThicknessM = 0.01;
constexpr int kNeighbors = 2;              // Links this near in the chain overlap by construction.
constexpr int kBoardNeighbors = 2;         // The board hangs on the last link; it may hide this many more.
constexpr double kAlwaysThereM = 1e-3;     // A joint that moves less than this does not move.

Eigen::Isometry3d toEigen(const urdf::Pose& pose) {
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  transform.linear() = Eigen::Quaterniond(pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z)
                           .normalized()
                           .toRotationMatrix();
  transform.translation() = Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z);
  return transform;
}

struct Shape {
  std::shared_ptr<fcl::CollisionGeometryd> geometry;
  RoundedBox rounded;  // The same once more, for gaps.
  Eigen::Isometry3d in_body = Eigen::Isometry3d::Identity();
};

Shape boxShape(const Eigen::Vector3d& size, const Eigen::Isometry3d& in_body) {
  return {std::make_shared<fcl::Boxd>(size), {0.5 * size, 0.0}, in_body};
}

Shape sphereShape(double radius, const Eigen::Isometry3d& in_body) {
  return {std::make_shared<fcl::Sphered>(radius), {Eigen::Vector3d::Zero(), radius}, in_body};
}

Shape capsuleShape(double radius, double length, const Eigen::Isometry3d& in_body) {
  return {std::make_shared<fcl::Capsuled>(radius, length), {{0.0, 0.0, 0.5 * length}, radius}, in_body};
}

struct Body {
  std::string name;
  std::vector<Shape> shapes;
};

struct JointModel {
  Eigen::Isometry3d origin;
  Eigen::Vector3d axis;
  bool turns = false;
};

std::optional<Shape> shapeOf(const urdf::Collision& collision) {
  const Eigen::Isometry3d in_body = toEigen(collision.origin);
  if (!collision.geometry) return std::nullopt;
  switch (collision.geometry->type) {
    case urdf::Geometry::BOX: {
      const auto& box = static_cast<const urdf::Box&>(*collision.geometry);
      return boxShape({box.dim.x, box.dim.y, box.dim.z}, in_body);
    }
    case urdf::Geometry::SPHERE:
      return sphereShape(static_cast<const urdf::Sphere&>(*collision.geometry).radius, in_body);
    case urdf::Geometry::CYLINDER: {
      const auto& cylinder = static_cast<const urdf::Cylinder&>(*collision.geometry);
      return capsuleShape(cylinder.radius, cylinder.length, in_body);
    }
    default: return std::nullopt;  // A mesh.
  }
}

Shape capsuleBetween(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius) {
  Eigen::Isometry3d in_body = Eigen::Isometry3d::Identity();
  in_body.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), to - from).toRotationMatrix();
  in_body.translation() = 0.5 * (from + to);
  return capsuleShape(radius, (to - from).norm(), in_body);
}

}  // namespace

struct CollisionModel::Impl {
  std::vector<JointModel> joints;     // One per link but the base.
  std::vector<Body> links;            // The base first.
  std::vector<int> turning;           // Joints that turn up to and including each link's own.
  std::vector<Box> boxes;
  std::vector<Body> box_bodies;
  std::vector<std::vector<bool>> exempt;  // Link by box.
  std::vector<Body> obstacles;
  std::vector<double> reach_m;        // Per turning joint: farther from its axis is nothing that it moves.
  BoardSpec board;
  std::optional<Body> plate;

  int degrees() const { return turning.back(); }

  std::vector<Eigen::Isometry3d> linkPoses(const Eigen::VectorXd& q) const {
    std::vector<Eigen::Isometry3d> poses{Eigen::Isometry3d::Identity()};
    Eigen::Index next = 0;
    for (const JointModel& joint : joints) {
      Eigen::Isometry3d pose = poses.back() * joint.origin;
      if (joint.turns) pose.rotate(Eigen::AngleAxisd(q[next++], joint.axis));
      poses.push_back(pose);
    }
    return poses;
  }

  void check(const Eigen::VectorXd& q) const {
    if (q.size() != degrees() || !q.allFinite())
      throw std::invalid_argument("CollisionModel: expected " + std::to_string(degrees()) + " finite joint angles");
  }

  // Calls visit(first body, its pose, second body, its pose) for every pair that must not touch, until it
  // returns false.
  template <class Visit>
  void pairs(const Eigen::VectorXd& q, const Visit& visit) const {
    check(q);
    const std::vector<Eigen::Isometry3d> poses = linkPoses(q);
    const Eigen::Isometry3d base = Eigen::Isometry3d::Identity();
    for (std::size_t i = 0; i < links.size(); ++i) {
      for (std::size_t box = 0; box < boxes.size(); ++box) {
        if (!exempt[i][box] && !visit(links[i], poses[i], box_bodies[box], base)) return;
      }
      for (const Body& obstacle : obstacles) {
        if (i > 0 && !visit(links[i], poses[i], obstacle, base)) return;
      }
      for (std::size_t j = i + 1; j < links.size(); ++j) {
        if (turning[j] - turning[i] > kNeighbors && !visit(links[i], poses[i], links[j], poses[j])) return;
      }
      if (plate && turning.back() - turning[i] > kBoardNeighbors && !visit(links[i], poses[i], *plate, poses.back()))
        return;
    }
    if (!plate) return;
    for (const Body& box : box_bodies) {
      if (!visit(*plate, poses.back(), box, base)) return;
    }
    for (const Body& obstacle : obstacles) {
      if (!visit(*plate, poses.back(), obstacle, base)) return;
    }
  }

  // From the tip inwards: what a joint moves is never farther from it than this.
  void findReach() {
    const auto extent = [](const Body& body) {
      double most = 0.0;
      for (const Shape& shape : body.shapes)
        most = std::max(most, shape.in_body.translation().norm() + shape.rounded.half_m.norm() + shape.rounded.radius_m);
      return most;
    };
    reach_m.clear();
    double reach = plate ? extent(*plate) : 0.0;
    for (std::size_t i = joints.size(); i-- > 0;) {
      reach = std::max(reach, extent(links[i + 1]));
      if (joints[i].turns) reach_m.insert(reach_m.begin(), reach);
      reach += joints[i].origin.translation().norm();
    }
  }

  void findExemptions() {
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> angle(-3.0, 3.0);
    std::vector<Eigen::Vector3d> first;
    std::vector<bool> moves(links.size(), false);
    for (int sample = 0; sample < 20; ++sample) {
      Eigen::VectorXd q(degrees());
      for (double& value : q) value = angle(random);
      const std::vector<Eigen::Isometry3d> poses = linkPoses(q);
      for (std::size_t i = 0; i < links.size(); ++i) {
        if (sample == 0) first.emplace_back(poses[i].translation());
        moves[i] = moves[i] || (poses[i].translation() - first[i]).norm() > kAlwaysThereM;
      }
    }
    exempt.assign(links.size(), std::vector<bool>(boxes.size(), false));
    for (std::size_t i = 0; i < links.size(); ++i) {
      for (std::size_t box = 0; box < boxes.size(); ++box)
        exempt[i][box] = i == 0 || (!moves[i] && boxes[box].contains(first[i]));
    }
  }
};

CollisionModel::CollisionModel(const ArmConfig& arm, const std::vector<Box>& keep_out, const BoardSpec& board)
    : impl_(std::make_unique<Impl>()) {
  const UrdfChain chain = readChain(arm);
  std::vector<urdf::LinkConstSharedPtr> links{chain.model->getLink(arm.base_link)};
  impl_->turning.push_back(0);
  for (const urdf::JointSharedPtr& joint : chain.joints) {
    links.push_back(chain.model->getLink(joint->child_link_name));
    const bool turns = joint->type != urdf::Joint::FIXED;
    impl_->joints.push_back({toEigen(joint->parent_to_joint_origin_transform),
                             Eigen::Vector3d(joint->axis.x, joint->axis.y, joint->axis.z).normalized(), turns});
    impl_->turning.push_back(impl_->turning.back() + (turns ? 1 : 0));
  }
  for (std::size_t i = 0; i < links.size(); ++i) {
    Body body{"link '" + links[i]->name + "'", {}};
    for (const urdf::CollisionSharedPtr& collision : links[i]->collision_array) {
      if (const auto shape = shapeOf(*collision)) body.shapes.push_back(*shape);
    }
    // What is not described reaches to the next joint.
    if (body.shapes.empty() && i + 1 < links.size()) {
      const Eigen::Vector3d next = impl_->joints[i].origin.translation();
      if (next.norm() > 1e-3) body.shapes.push_back(capsuleBetween(Eigen::Vector3d::Zero(), next, kLinkRadiusM));
    }
    impl_->links.push_back(std::move(body));
  }
  impl_->boxes = keep_out;
  for (const Box& box : keep_out) {
    const Eigen::Vector3d size = box.max_m - box.min_m;
    const Eigen::Isometry3d pose(Eigen::Translation3d(0.5 * (box.min_m + box.max_m)));
    impl_->box_bodies.push_back({"keep-out box '" + box.name + "'", {boxShape(size, pose)}});
  }
  impl_->board = board;
  impl_->findExemptions();
  impl_->findReach();
}

CollisionModel::~CollisionModel() = default;
CollisionModel::CollisionModel(CollisionModel&&) noexcept = default;

void CollisionModel::setBoard(const std::optional<Pose<EndEffector, Board>>& eMo) {
  impl_->plate.reset();
  if (!eMo) return impl_->findReach();
  const Eigen::Vector3d far = impl_->board.outline()[2];
  const Eigen::Vector3d size(2.0 * far.x(), 2.0 * far.y(), kBoardThicknessM);
  impl_->plate = Body{"board", {boxShape(size, eMo->isometry())}};
  impl_->findReach();
}

void CollisionModel::setObstacles(const std::vector<Sphere>& obstacles) {
  impl_->obstacles.clear();
  for (const Sphere& sphere : obstacles) {
    if (!sphere.center_b.allFinite() || !(sphere.radius_m > 0.0))
      throw std::invalid_argument("CollisionModel: obstacle '" + sphere.name + "' is not a sphere");
    const Eigen::Isometry3d pose(Eigen::Translation3d(sphere.center_b));
    impl_->obstacles.push_back({"space around '" + sphere.name + "'", {sphereShape(sphere.radius_m, pose)}});
  }
}

std::vector<CollisionModel::Gap> CollisionModel::gaps(const Eigen::VectorXd& q) const {
  std::vector<Gap> found;
  impl_->pairs(q, [&](const Body& a, const Eigen::Isometry3d& a_pose, const Body& b, const Eigen::Isometry3d& b_pose) {
    Gap least{std::numeric_limits<double>::infinity(), a.name.c_str(), b.name.c_str()};
    for (const Shape& one : a.shapes) {
      const Eigen::Isometry3d one_pose = a_pose * one.in_body;
      for (const Shape& other : b.shapes)
        least.distance_m = std::min(least.distance_m, gap(one.rounded, one_pose, other.rounded, b_pose * other.in_body));
    }
    found.push_back(least);
    return true;
  });
  return found;
}

double CollisionModel::travel(const Eigen::VectorXd& dq) const {
  double sum = 0.0;
  for (std::size_t joint = 0; joint < impl_->reach_m.size(); ++joint)
    sum += impl_->reach_m[joint] * std::abs(dq[static_cast<Eigen::Index>(joint)]);
  return sum;
}

std::optional<std::string> CollisionModel::contact(const Eigen::VectorXd& q) const {
  std::optional<std::string> found;
  const fcl::CollisionRequestd request;
  impl_->pairs(q, [&](const Body& a, const Eigen::Isometry3d& a_pose, const Body& b, const Eigen::Isometry3d& b_pose) {
    for (const Shape& one : a.shapes) {
      for (const Shape& other : b.shapes) {
        fcl::CollisionResultd result;
        if (fcl::collide(one.geometry.get(), a_pose * one.in_body, other.geometry.get(), b_pose * other.in_body,
                         request, result) == 0)
          continue;
        found = "The " + a.name + " would touch the " + b.name + ".";
        return false;
      }
    }
    return true;
  });
  return found;
}

double CollisionModel::clearance(const Eigen::VectorXd& q) const {
  double least = std::numeric_limits<double>::infinity();
  const fcl::DistanceRequestd request;
  impl_->pairs(q, [&](const Body& a, const Eigen::Isometry3d& a_pose, const Body& b, const Eigen::Isometry3d& b_pose) {
    for (const Shape& one : a.shapes) {
      for (const Shape& other : b.shapes) {
        fcl::DistanceResultd result;
        fcl::distance(one.geometry.get(), a_pose * one.in_body, other.geometry.get(), b_pose * other.in_body, request,
                      result);
        least = std::min(least, std::max(0.0, result.min_distance));
      }
    }
    return true;
  });
  return least;
}

}  // namespace servocal::robot
