// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/slip.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <stdexcept>

#include "median.h"
#include "se3.h"

namespace servocal::calib {
namespace {

constexpr double kOutlierSigma = 5.0;

/// One view's deviation: displacement (m) at the board and turn (rad).
struct Deviation {
  std::int64_t id = 0;
  std::string camera;
  Vector6d value;
};

/// The motion that takes `expected` to `seen`: what it does to `point`, and its turn.
Vector6d between(const Eigen::Isometry3d& expected, const Eigen::Isometry3d& seen,
                 const Eigen::Vector3d& point) {
  const Eigen::Isometry3d motion = seen * expected.inverse();
  const Eigen::AngleAxisd turn(motion.linear());
  Vector6d out;
  out << motion * point - point, turn.angle() * turn.axis();
  return out;
}

/// Mean place of the board in the base, of each camera's views.
std::map<std::string, Eigen::Vector3d> boardPlaces(const std::vector<SlipView>& views,
                                                   const Pose<EndEffector, Board>& eMo) {
  std::map<std::string, std::vector<Eigen::Vector3d>> all;
  for (const SlipView& view : views) all[view.camera].push_back((view.bMe * eMo).translation());
  std::map<std::string, Eigen::Vector3d> places;
  for (const auto& [camera, points] : all) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& point : points) sum += point;
    places[camera] = sum / static_cast<double>(points.size());
  }
  return places;
}

/// P(Wilks' lambda <= x) for six dimensions, one hypothesis and `freedom` degrees of freedom of the error:
/// the incomplete beta function with parameters (freedom - 5) / 2 and 3, which is elementary.
double chance(double x, double freedom) {
  const double a = 0.5 * (freedom - 5.0), y = 1.0 - x;
  return std::pow(x, a) * (1.0 + a * y + 0.5 * a * (a + 1.0) * y * y);
}

struct Step {
  std::int64_t id = 0;
  Vector6d value = Vector6d::Zero();
  double log_ratio = 0.0;
  double chance = 1.0;  // times the places tried
};

/// Sums of squares and products about a mean per camera.
Matrix6d scatter(const std::vector<Deviation>& all) {
  std::map<std::string, std::pair<Vector6d, int>> sums;
  for (const Deviation& one : all) {
    auto& [sum, count] = sums.try_emplace(one.camera, Vector6d::Zero(), 0).first->second;
    sum += one.value;
    ++count;
  }
  Matrix6d out = Matrix6d::Zero();
  for (const Deviation& one : all) {
    const auto& [sum, count] = sums.at(one.camera);
    const Vector6d centred = one.value - sum / count;
    out += centred * centred.transpose();
  }
  return out;
}

/// The most likely step; views sorted by time.
Step likeliestStep(const std::vector<Deviation>& all, int min_views) {
  Step best;
  std::set<std::string> cameras;
  for (const Deviation& one : all) cameras.insert(one.camera);
  const double freedom = static_cast<double>(all.size()) - static_cast<double>(cameras.size()) - 1.0;
  if (freedom < 8.0) return best;
  const Matrix6d without = scatter(all);
  // Indicator "after", less its mean per camera, is what a common step adds beside the means.
  int places = 0;
  for (std::size_t k = static_cast<std::size_t>(min_views);
       k + static_cast<std::size_t>(min_views) <= all.size(); ++k) {
    if (all[k].id == all[k - 1].id) continue;  // one stop, several cameras
    ++places;
    std::map<std::string, std::pair<double, double>> counts;  // after, all
    for (std::size_t i = 0; i < all.size(); ++i) {
      counts[all[i].camera].first += i >= k ? 1.0 : 0.0;
      counts[all[i].camera].second += 1.0;
    }
    Vector6d cross = Vector6d::Zero();
    double squares = 0.0;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const auto& [after, count] = counts[all[i].camera];
      const double indicator = (i >= k ? 1.0 : 0.0) - after / count;
      cross += indicator * all[i].value;
      squares += indicator * indicator;
    }
    if (!(squares > 1e-9)) continue;
    const Vector6d step = cross / squares;
    const Matrix6d with = without - squares * step * step.transpose();
    // Units differ by axis: compare scaled determinants.
    const Vector6d scale = without.diagonal().cwiseSqrt().cwiseMax(1e-15).cwiseInverse();
    const double lambda = Matrix6d(scale.asDiagonal() * with * scale.asDiagonal()).determinant() /
                          Matrix6d(scale.asDiagonal() * without * scale.asDiagonal()).determinant();
    if (!std::isfinite(lambda)) continue;
    const double log_ratio = -0.5 * static_cast<double>(all.size()) * std::log(std::max(lambda, 1e-300));
    if (log_ratio > best.log_ratio)
      best = {all[k].id, step, log_ratio, chance(std::clamp(lambda, 0.0, 1.0), freedom)};
  }
  best.chance *= places;
  return best;
}

/// Without the views that stand out from their neighbors' median on their side of the likeliest step.
Step robustStep(std::vector<Deviation> all, int min_views) {
  std::sort(all.begin(), all.end(), [](const Deviation& a, const Deviation& b) { return a.id < b.id; });
  Step step = likeliestStep(all, min_views);
  for (int round = 0; round < 3; ++round) {
    std::map<std::string, std::vector<Vector6d>> groups;
    std::vector<Vector6d> rest;
    for (const Deviation& one : all) {
      rest.push_back(one.value - (step.log_ratio > 0.0 && one.id >= step.id ? step.value : Vector6d::Zero()));
      groups[one.camera].push_back(rest.back());
    }
    std::map<std::string, Vector6d> middles;
    for (const auto& [camera, values] : groups) {
      for (int axis = 0; axis < 6; ++axis) {
        std::vector<double> of_axis;
        for (const Vector6d& value : values) of_axis.push_back(value[axis]);
        middles[camera][axis] = median(std::move(of_axis));
      }
    }
    Vector6d width;
    for (int axis = 0; axis < 6; ++axis) {
      std::vector<double> off;
      for (std::size_t i = 0; i < all.size(); ++i)
        off.push_back(std::abs(rest[i][axis] - middles[all[i].camera][axis]));
      width[axis] = 1.4826 * median(std::move(off));
    }
    std::vector<Deviation> kept;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const Vector6d off = (rest[i] - middles[all[i].camera]).cwiseAbs();
      if ((off.array() <= kOutlierSigma * width.array() + 1e-9).all()) kept.push_back(all[i]);
    }
    if (kept.size() == all.size()) break;
    all = std::move(kept);
    step = likeliestStep(all, min_views);
  }
  return step;
}

}  // namespace

const char* toString(SlipPart part) { return part == SlipPart::kMount ? "mount" : "camera"; }

std::optional<Slip> findSlip(const std::vector<SlipView>& views,
                             const std::map<std::string, Pose<Base, Color>>& bMc,
                             const Pose<EndEffector, Board>& eMo, const SlipOptions& options) {
  if (!eMo.isFinite()) throw std::invalid_argument("eMo is not finite");
  const std::map<std::string, Eigen::Vector3d> places = boardPlaces(views, eMo);
  std::vector<Deviation> on_flange;
  std::map<std::string, std::vector<Deviation>> in_base;
  for (const SlipView& view : views) {
    const auto camera = bMc.find(view.camera);
    if (camera == bMc.end()) throw std::invalid_argument("camera '" + view.camera + "' has no bMc");
    if (!view.bMe.isFinite() || !view.cMo.isFinite() || !camera->second.isFinite()) {
      throw std::invalid_argument("a pose of observation " + std::to_string(view.observation_id) +
                                  " is not finite");
    }
    on_flange.push_back({view.observation_id, view.camera,
                         between(eMo.isometry(), (view.bMe.inverse() * camera->second * view.cMo).isometry(),
                                 eMo.translation())});
    in_base[view.camera].push_back(
        {view.observation_id, view.camera,
         between(camera->second.isometry(), (view.bMe * eMo * view.cMo.inverse()).isometry(),
                 places.at(view.camera))});
  }
  Slip slip;
  Step step = robustStep(on_flange, options.min_views);
  for (const auto& [camera, deviations] : in_base) {
    const Step bump = robustStep(deviations, options.min_views);
    if (!(bump.log_ratio > step.log_ratio)) continue;
    step = bump;
    slip.part = SlipPart::kCamera;
    slip.camera = camera;
  }
  if (!(step.chance * static_cast<double>(1 + in_base.size()) < options.false_alarm)) return std::nullopt;
  slip.observation_id = step.id;
  slip.step_m = step.value.head<3>();
  slip.step_rad = step.value.tail<3>();
  if (slip.step_m.norm() < options.min_step_m && slip.step_rad.norm() < options.min_step_rad)
    return std::nullopt;
  slip.log_likelihood_ratio = step.log_ratio;
  char text[256];
  std::snprintf(text, sizeof text,
                "%s%s%s moved before observation %lld: by %.1f mm at the board and %.2f deg",
                slip.part == SlipPart::kMount ? "the board on the flange" : "camera '", slip.camera.c_str(),
                slip.part == SlipPart::kMount ? "" : "'", static_cast<long long>(slip.observation_id),
                1e3 * slip.step_m.norm(), slip.step_rad.norm() * 180.0 / M_PI);
  slip.sentence = text;
  return slip;
}

}  // namespace servocal::calib
