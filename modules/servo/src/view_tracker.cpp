// SPDX-License-Identifier: GPL-3.0-or-later
#include "view_tracker.h"

#include <algorithm>

namespace servocal::servo {

std::vector<ImagePoint> imagePoints(const Pose<Color, Board>& cMo,
                                    const std::vector<Eigen::Vector3d>& points_o) {
  std::vector<ImagePoint> result;
  result.reserve(points_o.size());
  for (const Eigen::Vector3d& point_o : points_o) {
    const Eigen::Vector3d point_c = cMo * point_o;
    const double depth = std::max(point_c.z(), 1e-3);
    result.push_back({point_c.head<2>() / depth, depth});
  }
  return result;
}

ViewTracker::ViewTracker(const std::vector<Eigen::Vector3d>& points_o, const CellEstimate& cell)
    : points_o_(points_o), cell_(cell) {}

bool ViewTracker::update(const Sight& sight, const Pose<Base, EndEffector>& bMe_seen) {
  if (sight.pixels.size() != points_o_.size() || !sight.cMo.isFinite() || !bMe_seen.isFinite()) return false;
  const std::vector<ImagePoint> model = imagePoints(sight.cMo, points_o_);
  std::vector<Eigen::Vector2d> difference;
  for (std::size_t i = 0; i < points_o_.size(); ++i) {
    if (!sight.pixels[i].allFinite() || (sight.cMo * points_o_[i]).z() < 1e-3) return false;
    const std::optional<Eigen::Vector2d> measured = cell_.camera.unproject(sight.pixels[i]);
    if (!measured) return false;
    difference.push_back(*measured - model[i].s);
  }
  measured_minus_model_ = std::move(difference);
  cMo_seen_ = sight.cMo;
  bMe_seen_ = bMe_seen;
  return true;
}

View ViewTracker::at(const Pose<Base, EndEffector>& bMe) const {
  View view;
  if (cell_.mount == Mount::kFixed) {
    view.cMe = cMo_seen_ * cell_.eMo.inverse() * bMe_seen_.inverse() * bMe;
    view.cMo = view.cMe * cell_.eMo;
  } else {
    view.cMe = cell_.eMc.inverse();
    view.cMo = view.cMe * bMe.inverse() * bMe_seen_ * cell_.eMc * cMo_seen_;
    view.sign = -1.0;
  }
  view.points = imagePoints(view.cMo, points_o_);
  for (std::size_t i = 0; i < view.points.size(); ++i) view.points[i].s += measured_minus_model_[i];
  return view;
}

}  // namespace servocal::servo
