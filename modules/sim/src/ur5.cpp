// SPDX-License-Identifier: GPL-3.0-or-later
#include "ur5.h"

namespace servocal::sim {

Ur5::Ur5()
    : joints_{{{0.0, M_PI / 2, 0.089159, 0.0},
               {-0.425, 0.0, 0.0, 0.0},
               {-0.39225, 0.0, 0.0, 0.0},
               {0.0, M_PI / 2, 0.10915, 0.0},
               {0.0, -M_PI / 2, 0.09465, 0.0},
               {0.0, 0.0, 0.0823, 0.0}}} {}

std::array<Eigen::Isometry3d, 7> Ur5::frames(const Vector6d& q) const {
  std::array<Eigen::Isometry3d, 7> frames;
  frames[0].setIdentity();
  for (int i = 0; i < 6; ++i) {
    const DhJoint& joint = joints_[i];
    const double c = std::cos(q[i] + joint.offset_rad), s = std::sin(q[i] + joint.offset_rad);
    const double ca = std::cos(joint.alpha_rad), sa = std::sin(joint.alpha_rad);
    Eigen::Isometry3d step = Eigen::Isometry3d::Identity();
    step.linear() << c, -s * ca, s * sa,  //
        s, c * ca, -c * sa,               //
        0.0, sa, ca;
    step.translation() << joint.a_m * c, joint.a_m * s, joint.d_m;
    frames[i + 1] = frames[i] * step;
  }
  return frames;
}

Eigen::Isometry3d Ur5::forward(const Vector6d& q) const { return frames(q)[6]; }

Matrix6d Ur5::jacobian(const Vector6d& q) const {
  const auto frame = frames(q);
  const Eigen::Vector3d flange = frame[6].translation();
  Matrix6d jacobian;
  for (int i = 0; i < 6; ++i) {
    const Eigen::Vector3d axis = frame[i].linear().col(2);
    jacobian.col(i) << axis.cross(flange - frame[i].translation()), axis;
  }
  return jacobian;
}

}  // namespace servocal::sim
