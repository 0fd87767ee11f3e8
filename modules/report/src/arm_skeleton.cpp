// SPDX-License-Identifier: GPL-3.0-or-later
#include "arm_skeleton.h"

#include <Eigen/Geometry>
#include <cmath>
#include <optional>

#include "servocal/core/cell_config.h"
#include "servocal/core/error.h"
#include "servocal/robot/kinematics.h"

namespace servocal::report {
namespace {

struct Axis {
  Eigen::Vector3d point, direction;
};

std::vector<Axis> axesOf(const robot::Kinematics& kinematics, const Eigen::VectorXd& q) {
  const Eigen::Vector3d flange = kinematics.forward(q).translation();
  const Eigen::MatrixXd jacobian = kinematics.jacobian(q);
  std::vector<Axis> axes;
  for (Eigen::Index joint = 0; joint < jacobian.cols(); ++joint) {
    // A turn about an axis moves the flange by direction x (flange - point).
    const Eigen::Vector3d moves = jacobian.col(joint).head<3>(), direction = jacobian.col(joint).tail<3>();
    axes.push_back({flange - moves.cross(direction), direction});
  }
  return axes;
}

ArmLine lineOf(const robot::Kinematics& kinematics, const Eigen::VectorXd& q) {
  const std::vector<Axis> axes = axesOf(kinematics, q);
  ArmLine line = {Eigen::Vector3d::Zero()};
  const auto reach = [&line](const Eigen::Vector3d& point) {
    if ((point - line.back()).norm() > 0.005) line.push_back(point);
  };
  for (std::size_t i = 0; i + 1 < axes.size(); ++i) {
    const Axis &one = axes[i], &next = axes[i + 1];
    const Eigen::Vector3d normal = one.direction.cross(next.direction);
    const Eigen::Vector3d apart = next.point - one.point;
    // Along `one` to where `next` is nearest; parallel axes are equally near everywhere, so from where we
    // are.
    const double along = normal.squaredNorm() > 1e-6
                             ? apart.cross(next.direction).dot(normal) / normal.squaredNorm()
                             : one.direction.dot(line.back() - one.point);
    reach(one.point + along * one.direction);
    reach(next.point + next.direction.dot(line.back() - next.point) * next.direction);
  }
  reach(kinematics.forward(q).translation());
  return line;
}

std::optional<robot::Kinematics> kinematicsOf(const ReportInput& input) {
  if (input.cell_text.empty()) return std::nullopt;
  try {
    return robot::Kinematics(parseCell(input.cell_text, "cell file").arm);
  } catch (const Error&) {
    return std::nullopt;  // The URDF may not be where the report is made; the arm is only decoration.
  }
}

}  // namespace

std::vector<ArmLine> armLines(const ReportInput& input, int most) {
  std::vector<ArmLine> lines;
  const auto kinematics = kinematicsOf(input);
  if (!kinematics) return lines;
  std::vector<Eigen::VectorXd> drawn;
  constexpr double kApartRad = 0.9;
  for (const Observation& observation : input.observations) {
    if (!observation.robot || observation.robot->q.size() != kinematics->joints()) continue;
    const Eigen::VectorXd& q = observation.robot->q;
    if (!q.allFinite()) continue;
    bool near = false;
    for (const Eigen::VectorXd& other : drawn) near = near || (q - other).cwiseAbs().maxCoeff() < kApartRad;
    if (near) continue;
    drawn.push_back(q);
    lines.push_back(lineOf(*kinematics, q));
    if (static_cast<int>(lines.size()) == most) break;
  }
  return lines;
}

}  // namespace servocal::report
