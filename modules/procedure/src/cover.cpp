// SPDX-License-Identifier: GPL-3.0-or-later
// The coverage loop: the most valuable view -> servo there -> settle -> observe -> save -> believe.
#include <algorithm>
#include <cmath>
#include <map>

#include "resume.h"
#include "run.h"
#include "servocal/coverage/coverage.h"
#include "servocal/plan/next_view.h"

namespace servocal::procedure {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr int kTries = 3;  // for one image cell, or for distances and tilts, before they are given up

/// Drives that brought nothing new to one image cell, or to distances and tilts.
struct Failures {
  int drives = 0;
  bool is_reach = true;  ///< The arm's limits ended all of them.
  void add(DriveStatus status) {
    ++drives;
    is_reach = is_reach && (status == DriveStatus::kUnreachable || status == DriveStatus::kLimit);
  }
};

/// Only what the arm does not reach counts as done.
void leave(coverage::Coverage& coverage, std::optional<int> cell, bool is_reach) {
  if (cell) {
    is_reach ? coverage.giveUp(*cell) : coverage.setAside(*cell);
  } else {
    is_reach ? coverage.giveUpMarginals() : coverage.setMarginalsAside();
  }
}

/// The largest angle at which the board is sure to be detected, by the tilt search.
double detectableTilt(const std::vector<TiltLimit>& limits) {
  double tilt = 75 * kDegree;
  for (const TiltLimit& limit : limits) {
    if (limit.direction.rfind("roll", 0) != 0 && limit.ended_by == "detection") {
      tilt = std::min(tilt, limit.limit_rad - 5 * kDegree);
    }
  }
  return std::max(tilt, 15 * kDegree);
}

plan::PlanOptions planOptions(const CoverageConfig& config, const Eye& eye) {
  return plan::coveragePlan(config, eye.model(), detectableTilt(eye.tilt_limits));
}

/// Straight, or if something is in the way around it: beside a singular pose no straight way is open. The reason if
/// neither.
std::optional<std::string> goTo(Run& run, const Pose<Base, EndEffector>& bMe) {
  return run.moveTo(bMe) ? run.travelTo(bMe) : std::nullopt;
}

/// Drives the board to what `coverage` lacks, at most `max_views` times. A coverage of its own, not the eye's,
/// is counted here. Returns the views taken.
int fill(Run& run, Eye& eye, coverage::Coverage& coverage, const plan::PlanOptions& plan_options,
         const std::string& stage, int max_views) {
  const Eigen::VectorXd start_q = run.guard().state().q;
  const Instant begin = run.clock().now();
  std::vector<Pose<Color, Board>> tried;
  std::map<std::optional<int>, Failures> failures;  // by cell; nothing: distances and tilts
  int views = &coverage == &eye.coverage ? 0 : viewsTaken(run, stage, eye, coverage);
  run.report(stage, eye, 0, max_views);
  while (views < max_views && !coverage.exhausted() && !eye.tooLate()) {
    const plan::Belief belief{eye.model(), *eye.bMc(), run.eMo(eye), run.mount()};
    const plan::NextView next = plan::nextView(coverage, belief, run.cell().board, run.guard(),
                                               run.guard().state().q, start_q, tried, plan_options);
    for (const int cell : next.unreachable) leave(coverage, cell, failures[cell].is_reach);
    if (!next.view) {
      leave(coverage, std::nullopt, failures[std::nullopt].is_reach);
      break;
    }

    tried.push_back(next.view->cdMo);  // The same view again would add corners, but nothing new.
    Failures& failed = failures[next.view->cell];
    const auto fail = [&](DriveStatus status) {
      failed.add(status);
      if (failed.drives == kTries) leave(coverage, next.view->cell, failed.is_reach);
    };
    run.backInSight(eye);
    // The servo needs to see the board; another eye's last view may be out of this one's image.
    if ((next.view->via_start && goTo(run, run.guard().kinematics().forward(start_q))) ||
        (!eye.canStart(run.guard().state().bMe, run.eMo(eye)) && goTo(run, next.view->bMe))) {
      fail(DriveStatus::kLimit);
      continue;
    }
    const int deficit = coverage.deficit();
    const Run::Visit visit = run.visit(stage, eye, next.view->cdMo);
    if (visit.observation) {
      ++views;
      if (&coverage != &eye.coverage) {
        const StreamObservation& view = visit.observation->views.front();
        std::vector<Eigen::Vector2d> pixels;
        for (const Corner& corner : view.detection.corners) pixels.push_back(corner.pixel);
        coverage.add(pixels, next.view->cdMo);
      }
      run.updateBelief(eye);
    }
    if (coverage.deficit() == deficit) fail(visit.drive.status);
    const double per_view_s = toSeconds(run.clock().now() - begin) / std::max(1, views);
    const int open = static_cast<int>(coverage.openCells().size());
    run.setEta(per_view_s * std::min(max_views - views, std::max(1, (open + 1) / 2)));
    run.report(stage, eye, views, max_views,
               visit.observation ? "" : std::string(toString(visit.drive.status)) + ": " + visit.drive.reason);
  }
  return views;
}

/// Coverage goals of a few views of the whole image.
coverage::Coverage sparse(const Run& run, const Eye& eye, int cells_x, int cells_y, const coverage::ViewGoals& goals) {
  CoverageConfig config = run.cell().coverage;
  config.cells_x = cells_x;
  config.cells_y = cells_y;
  config.corners_per_cell = 6;
  return {config, ImageRegion{0, 0, eye.model().width_px, eye.model().height_px}, goals};
}

}  // namespace

int cover(Run& run, Eye& eye, int max_views) {
  return fill(run, eye, eye.coverage, planOptions(run.cell().coverage, eye), "cover", max_views);
}

void revisit(Run& run, Eye& eye) {
  const int views = run.cell().coverage.revisit_views;
  coverage::ViewGoals goals;
  goals.near_views = views / 2;
  goals.far_views = views - views / 2;
  goals.views_per_tilt_bin = 0;
  coverage::Coverage places = sparse(run, eye, 3, 2, goals);
  plan::PlanOptions options = planOptions(run.cell().coverage, eye);
  options.tilt_rad = options.roll_rad = 0.0;
  fill(run, eye, places, options, "revisit", views);
}

void takeCheckViews(Run& run, Eye& eye) {
  // Those that it had at stops made for other eyes are views that no solver sees too.
  const int views = run.cell().coverage.check_views - viewsBesides(run, kCheckStage, eye);
  coverage::ViewGoals goals;
  goals.near_views = 0;
  goals.far_views = views;
  goals.views_per_tilt_bin = 0;
  coverage::Coverage places = sparse(run, eye, 2, 2, goals);
  plan::PlanOptions options = planOptions(run.cell().coverage, eye);
  options.tilt_rad *= 0.6;
  fill(run, eye, places, options, kCheckStage, views);
}

}  // namespace servocal::procedure
