// SPDX-License-Identifier: GPL-3.0-or-later
// The coverage loop: the most valuable view -> servo there -> settle -> observe -> save -> believe.
#include <algorithm>
#include <cmath>
#include <map>

#include "run.h"
#include "servocal/coverage/coverage.h"
#include "servocal/plan/next_view.h"

namespace servocal::procedure {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr int kTriesPerCell = 3;

/// Lean of tilted views: well inside what the detector can do, at most what still adds information.
double usableTilt(const std::vector<TiltLimit>& limits) {
  double tilt = 40 * kDegree;
  for (const TiltLimit& limit : limits) {
    if (limit.direction.rfind("roll", 0) != 0 && limit.ended_by == "detection") {
      tilt = std::min(tilt, limit.limit_rad - 5 * kDegree);
    }
  }
  return std::max(tilt, 15 * kDegree);
}

}  // namespace

CoverResult cover(Run& run, const std::vector<TiltLimit>& tilt_limits) {
  const CoverageConfig& config = run.cell().coverage;
  const CameraConfig& camera = run.cell().cameras.front();
  coverage::Coverage coverage(config, camera.width_px, camera.height_px);
  plan::PlanOptions plan_options;
  plan_options.tilt_rad = usableTilt(tilt_limits);
  plan_options.distances_m = {config.near_distance_m, 1.08 * config.distance_ratio * config.near_distance_m,
                              1.3 * config.distance_ratio * config.near_distance_m};

  const Eigen::VectorXd start_q = run.guard().state().q;
  const Instant begin = run.clock().now();
  std::vector<Pose<Color, Board>> tried;
  std::map<int, int> failures;
  CoverResult result;
  run.report("cover", 0, config.max_views);
  while (result.views < config.max_views && !coverage.complete()) {
    const plan::Belief belief{run.observer().model(), run.bMc(), run.eMo()};
    const plan::NextView next = plan::nextView(coverage, belief, run.cell().board, run.guard(),
                                               run.guard().state().q, start_q, tried, plan_options);
    for (const int cell : next.unreachable) coverage.giveUp(cell);
    if (!next.view) break;

    if (next.view->via_start) run.moveTo(run.guard().kinematics().forward(start_q));
    const Run::Visit visit = run.visit("cover", next.view->cdMo);
    bool helped = false;
    if (visit.observation) {
      ++result.views;
      const StreamObservation& seen = visit.observation->views.front();
      std::vector<Eigen::Vector2d> pixels;
      for (const Corner& corner : seen.detection.corners) pixels.push_back(corner.pixel);
      if (const auto cMo = run.observer().poseOf(seen.detection, seen.stamp)) {
        helped = coverage.missingCorners(pixels) + coverage.missingMarginals(*cMo) > 0;
        coverage.add(pixels, *cMo);
      }
      run.updateBelief();
    }
    if (!helped) {
      tried.push_back(next.view->cdMo);
      if (next.view->cell && ++failures[*next.view->cell] >= kTriesPerCell) coverage.giveUp(*next.view->cell);
    }
    const double per_view_s = toSeconds(run.clock().now() - begin) / std::max(1, result.views);
    const int open = static_cast<int>(coverage.openCells().size());
    run.setEta(per_view_s * std::min(config.max_views - result.views, std::max(1, (open + 1) / 2)));
    run.report("cover", result.views, config.max_views,
               visit.observation ? "" : std::string(toString(visit.drive.status)) + ": " + visit.drive.reason);
  }
  result.summary = coverage.summary();
  result.missing = coverage.missing();
  return result;
}

}  // namespace servocal::procedure
