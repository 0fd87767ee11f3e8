// SPDX-License-Identifier: GPL-3.0-or-later
#include "rotation_format.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>

namespace servocal::session {
namespace {

std::string axesOf(const std::string& order) { return order.substr(order.find('_') + 1); }

bool isIntrinsic(const std::string& order) { return order.rfind("intrinsic", 0) == 0; }

}  // namespace

const std::vector<std::string>& eulerOrders() {
  static const std::vector<std::string> orders = [] {
    std::vector<std::string> all;
    for (const char* kind : {"extrinsic_", "intrinsic_"}) {
      for (const char* axes :
           {"xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "xyx", "xzx", "yxy", "yzy", "zxz", "zyz"}) {
        all.push_back(std::string(kind) + axes);
      }
    }
    return all;
  }();
  return orders;
}

std::vector<std::string> eulerAngleNames(const std::string& order) {
  const std::string axes = axesOf(order);
  if (axes[0] == axes[2]) return {"a1", "a2", "a3"};
  return {"rx", "ry", "rz"};
}

Eigen::Matrix3d fromEuler(const std::string& order, const Eigen::Vector3d& angles_rad) {
  const std::string axes = axesOf(order);
  const bool by_axis = axes[0] != axes[2];
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 3; ++i) {
    const int axis = axes[static_cast<std::size_t>(i)] - 'x';
    const Eigen::AngleAxisd turn(angles_rad[by_axis ? axis : i], Eigen::Vector3d::Unit(axis));
    // About moving axes the next turn comes on the right, about fixed axes on the left.
    rotation = isIntrinsic(order) ? rotation * turn.toRotationMatrix() : turn.toRotationMatrix() * rotation;
  }
  return rotation;
}

double distanceFromRotation(const Eigen::Matrix3d& matrix) {
  if (matrix.determinant() <= 0.0) return 2.0;
  return (matrix.transpose() * matrix - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
}

Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& matrix) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

}  // namespace servocal::session
