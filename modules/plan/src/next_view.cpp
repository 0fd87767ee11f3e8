// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/plan/next_view.h"

#include <algorithm>
#include <cmath>

#include "servocal/core/mount.h"
#include "way.h"

namespace servocal::plan {
namespace {

constexpr int kMinCornersInCell = 6;  // a view that brings fewer to its cell is not worth the drive

struct Candidate {
  Pose<Color, Board> cdMo;
  std::vector<Eigen::Vector2d> pixels;
  double utility = 0.0;
};

/// Rotations of the board against the image plane: one per tilt bin, and two rolled ones.
std::vector<Eigen::Matrix3d> orientations(const PlanOptions& options) {
  using Eigen::AngleAxisd;
  using Eigen::Vector3d;
  const double tilt = options.tilt_rad, roll = options.roll_rad;
  std::vector<Eigen::Matrix3d> rotations = {Eigen::Matrix3d::Identity()};
  for (const double sign : {-1.0, 1.0}) {
    rotations.push_back(AngleAxisd(sign * tilt, Vector3d::UnitX()).toRotationMatrix());
    rotations.push_back(AngleAxisd(sign * tilt, Vector3d::UnitY()).toRotationMatrix());
    rotations.push_back(AngleAxisd(sign * roll, Vector3d::UnitZ()).toRotationMatrix());
    rotations.push_back((AngleAxisd(sign * 0.6 * tilt, Vector3d::UnitX()) *
                         AngleAxisd(sign * roll, Vector3d::UnitZ()))
                            .toRotationMatrix());
  }
  return rotations;
}

}  // namespace

PlanOptions coveragePlan(const CoverageConfig& config, const CameraModel& camera, double detectable_tilt_rad) {
  constexpr double kUsefulTiltRad = 40.0 * M_PI / 180.0;  // More adds little.
  constexpr double kMarginOfHeight = 0.022;               // 24 px of 1080
  PlanOptions options;
  options.max_obliquity_rad = detectable_tilt_rad;
  options.tilt_rad = std::min(kUsefulTiltRad, detectable_tilt_rad);
  options.image_margin_px = kMarginOfHeight * camera.height_px;
  options.distances_m = {config.near_distance_m, 1.08 * config.distance_ratio * config.near_distance_m,
                         1.3 * config.distance_ratio * config.near_distance_m};
  return options;
}

NextView nextView(const coverage::Coverage& coverage, const Belief& belief, const BoardSpec& board,
                  const robot::Guard& guard, const Eigen::VectorXd& current_q, const Eigen::VectorXd& start_q,
                  const std::vector<Pose<Color, Board>>& tried, const PlanOptions& options) {
  const CameraModel& camera = belief.camera;
  const auto bMe_now = guard.kinematics().forward(current_q);
  const auto bMeOf = [&](const Pose<Color, Board>& cdMo) { 
    return forMount(belief.mount, belief.bMc * cdMo * belief.eMo.inverse());
  };
  const auto rotations = orientations(options);
  const BoardPoints points(board);

  // Candidates that serve `cell`, or the marginals anywhere near the image centre, best first.
  const auto candidatesFor = [&](std::optional<int> cell) {
    constexpr int kSteps = 8;  // image positions per side of the window around the cell
    const Eigen::Vector2d size(camera.width_px, camera.height_px);
    const Eigen::Vector2d middle = cell ? coverage.cellCenter(*cell) : Eigen::Vector2d(0.5 * size);
    std::vector<Candidate> candidates;
    for (int i = -kSteps; i <= kSteps; ++i) {
      for (int j = -kSteps; j <= kSteps; ++j) {
        const Eigen::Vector2d pixel = middle + Eigen::Vector2d(i * 0.2 / kSteps, j * 0.25 / kSteps).cwiseProduct(size);
        const auto ray = camera.unproject(pixel);
        if (!ray || !camera.contains(pixel)) continue;
        for (const double distance_m : options.distances_m) {
          for (const Eigen::Matrix3d& rotation : rotations) {
            if (rotation.col(2).dot(ray->homogeneous().normalized()) < std::cos(options.max_obliquity_rad)) continue;
            Candidate candidate{Pose<Color, Board>(rotation, distance_m * ray->homogeneous()), {}, 0.0};
            const int marginals = coverage.missingMarginals(candidate.cdMo);
            if (!cell && marginals == 0) continue;
            auto pixels = visibleCorners(candidate.cdMo, camera, points, options.image_margin_px);
            if (!pixels) continue;
            bool fills_cell = false;
            if (cell) {
              const int missing = coverage.missingToFill(*cell);
              const auto in_cell = std::count_if(pixels->begin(), pixels->end(), [&](const auto& p) {
                return coverage.cellAt(p) == cell;
              });
              if (in_cell < std::min(missing, kMinCornersInCell)) continue;
              fills_cell = in_cell >= missing;
            }
            candidate.pixels = std::move(*pixels);
            candidate.utility = (coverage.missingCorners(candidate.pixels) + 5.0 * marginals + 8.0 * fills_cell) /
                                (kStopTimeS + travelTimeS(bMe_now, bMeOf(candidate.cdMo), guard.limits()));
            candidates.push_back(std::move(candidate));
          }
        }
      }
    }
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.utility > b.utility; });
    return candidates;
  };

  const auto firstReachable = [&](const std::vector<Candidate>& candidates,
                                  std::optional<int> cell) -> std::optional<PlannedView> {
    std::vector<const Candidate*> blocked;  // reachable somehow, but not straight from here
    for (const Candidate& candidate : candidates) {
      if (isTried(tried, candidate.cdMo)) continue;
      const auto bMe = bMeOf(candidate.cdMo);
      const auto q = guard.kinematics().inverse(bMe, current_q, guard.limits().joint_margin_rad);
      if (!q || !guard.allows(*q)) continue;
      if (straightWayFree(guard, current_q, bMe, options.min_singular_value)) {
        return PlannedView{candidate.cdMo, bMe, cell, false};
      }
      if (blocked.size() < 40) blocked.push_back(&candidate);
    }
    if (!straightWayFree(guard, current_q, guard.kinematics().forward(start_q), options.min_singular_value)) {
      return std::nullopt;
    }
    for (const Candidate* candidate : blocked) {
      const auto bMe = bMeOf(candidate->cdMo);
      if (straightWayFree(guard, start_q, bMe, options.min_singular_value)) {
        return PlannedView{candidate->cdMo, bMe, cell, true};
      }
    }
    return std::nullopt;
  };

  NextView next;
  for (const int cell : coverage.openCells()) {
    next.view = firstReachable(candidatesFor(cell), cell);
    if (next.view) return next;
    next.unreachable.push_back(cell);
  }
  next.view = firstReachable(candidatesFor(std::nullopt), std::nullopt);
  return next;
}

}  // namespace servocal::plan
