// SPDX-License-Identifier: GPL-3.0-or-later
#include <stdexcept>

#include "se3.h"
#include "servocal/calib/camera_pair.h"

namespace servocal::calib {

CameraPair pairByRobot(const PairCamera& first, const HandEyeSolution& first_stands, const PairCamera& second,
                       const HandEyeSolution& second_stands) {
  if (first_stands.mount != second_stands.mount) {
    throw std::invalid_argument("cameras in the cell and on the flange do not stand still to each other");
  }
  CameraPair pair;
  pair.first = first.name;
  pair.second = second.name;
  pair.first_by_second = first_stands.camera_pose.inverse() * second_stands.camera_pose;
  // A turn of the first camera about its origin swings the second one; all along the axes of the first.
  const Eigen::Matrix3d cRb = first_stands.camera_pose.linear().transpose();
  Matrix6d by_first = Matrix6d::Zero(), by_second = Matrix6d::Zero();
  by_second.topLeftCorner<3, 3>() = by_second.bottomRightCorner<3, 3>() = cRb;
  by_first.topLeftCorner<3, 3>() = by_first.bottomRightCorner<3, 3>() = -cRb;
  by_first.topRightCorner<3, 3>() =
      cRb * skew(second_stands.camera_pose.translation() - first_stands.camera_pose.translation());
  pair.covariance = by_first * first_stands.camera_sigma.cwiseAbs2().asDiagonal() * by_first.transpose() +
                    by_second * second_stands.camera_sigma.cwiseAbs2().asDiagonal() * by_second.transpose();
  return pair;
}

}  // namespace servocal::calib
