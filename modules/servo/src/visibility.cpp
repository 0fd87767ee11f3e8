// SPDX-License-Identifier: GPL-3.0-or-later
#include "visibility.h"

#include <algorithm>

namespace servocal::servo {
namespace {

constexpr double kLeverM = 0.2;  // A radian weighs like this many metres.
constexpr int kSweeps = 200;

}  // namespace

std::optional<PixelMotion> pixelMotion(const CameraModel& camera, const View& view,
                                       const std::vector<Eigen::Vector3d>& points_o) {
  PixelMotion motion;
  motion.rates.resize(2 * static_cast<Eigen::Index>(points_o.size()), 6);
  const Eigen::Matrix3d cRe = view.sign * view.cMe.rotation();
  const Pose<EndEffector, Board> eMo = view.cMe.inverse() * view.cMo;
  for (std::size_t i = 0; i < points_o.size(); ++i) {
    const ImagePoint& point = view.points[i];
    ProjectionJacobian jacobian;
    const std::optional<Eigen::Vector2d> pixel =
        camera.project(point.depth_m * Eigen::Vector3d(point.s.x(), point.s.y(), 1.0), jacobian);
    if (!pixel) return std::nullopt;
    motion.pixels.push_back(*pixel);
    // A point of the target moves with v + w x r, r from the flange; or the camera does.
    const Eigen::Vector3d r = eMo * points_o[i];
    Eigen::Matrix3d minus_cross;
    minus_cross << 0, r.z(), -r.y(), -r.z(), 0, r.x(), r.y(), -r.x(), 0;
    auto rows = motion.rates.middleRows<2>(2 * static_cast<Eigen::Index>(i));
    rows.leftCols<3>() = jacobian.point * cRe;
    rows.rightCols<3>() = jacobian.point * cRe * minus_cross;
  }
  return motion;
}

Twist<EndEffector> keepInView(const Twist<EndEffector>& wanted, const PixelMotion& motion,
                              const CameraModel& camera, double margin_px, double rate_per_s) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  Vector6 x;
  x << wanted.linear_mps, kLeverM * wanted.angular_radps;

  struct Constraint {
    Vector6 normal;
    double bound;
    double square;
    double multiplier = 0.0;
  };
  std::vector<Constraint> constraints;
  const Eigen::Vector2d last(camera.width_px - 1.0, camera.height_px - 1.0);
  for (std::size_t i = 0; i < motion.pixels.size(); ++i) {
    for (Eigen::Index axis = 0; axis < 2; ++axis) {
      Vector6 rate = motion.rates.row(2 * static_cast<Eigen::Index>(i) + axis).transpose();
      rate.tail<3>() /= kLeverM;
      const double square = rate.squaredNorm();
      if (square == 0.0) continue;
      const double pixel = motion.pixels[i][axis];
      const double low_room = std::max(0.0, pixel - margin_px);
      const double high_room = std::max(0.0, last[axis] - margin_px - pixel);
      constraints.push_back({-rate, rate_per_s * low_room, square});
      constraints.push_back({rate, rate_per_s * high_room, square});
    }
  }

  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    double change = 0.0;
    for (Constraint& constraint : constraints) {
      const double excess = (constraint.normal.dot(x) - constraint.bound) / constraint.square;
      const double step = std::max(excess, -constraint.multiplier);
      if (step == 0.0) continue;
      constraint.multiplier += step;
      x -= step * constraint.normal;
      change = std::max(change, std::abs(step) * std::sqrt(constraint.square));
    }
    if (change < 1e-6) break;
  }
  double scale = 1.0;
  for (const Constraint& constraint : constraints) {
    const double rate = constraint.normal.dot(x);
    if (rate > constraint.bound + 1e-3) scale = std::min(scale, constraint.bound / rate);
  }
  x *= scale;
  return {x.head<3>(), x.tail<3>() / kLeverM};
}

}  // namespace servocal::servo
