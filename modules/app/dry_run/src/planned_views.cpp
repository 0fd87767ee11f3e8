// SPDX-License-Identifier: GPL-3.0-or-later
#include "planned_views.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "servocal/core/mount.h"

namespace servocal::app {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr double kStopS = 1.5;  // Settling and grabbing, as the planner has it.
constexpr double kTiltTurnsDeg =
    2 * (2 * 45 + 4 * 75);  // Of the tilt search, there and back, if every tilt is seen.
constexpr int kTiltStops = 2 * 3 + 4 * 5;
constexpr double kFarEnoughM = 0.1;  // Distances are exact up to here.

std::vector<Eigen::Vector2d> cornersIn(const CameraModel& camera, const BoardSpec& board,
                                       const Pose<Color, Board>& cMo) {
  std::vector<Eigen::Vector2d> pixels;
  for (const Eigen::Vector3d& corner : board.corners()) {
    const auto pixel = camera.project(cMo * corner);
    if (pixel && camera.contains(*pixel)) pixels.push_back(*pixel);
  }
  return pixels;
}

std::string describe(const std::string& stage, const plan::PlannedView& view, int cells_x) {
  const double lean_deg = std::acos(std::clamp(view.cdMo.rotation()(2, 2), -1.0, 1.0)) / kDegree;
  char text[120];
  std::snprintf(text, sizeof text, "%s: board at %.2f m, leaning %.0f deg", stage.c_str(),
                view.cdMo.translation().z(), lean_deg);
  std::string what = text;
  if (view.cell)
    what += ", for cell " + std::to_string(*view.cell % cells_x + 1) + "," +
            std::to_string(*view.cell / cells_x + 1);
  if (view.via_start) what += ", by way of the start pose";
  return what;
}

/// Plans until nothing is missing; every view counts as seen once it is planned.
void fill(const std::string& stage, const BoardSpec& board, const plan::Belief& belief,
          const plan::PlanOptions& options, coverage::Coverage& coverage, int cells_x, int most,
          Pencil& pencil, std::vector<PlannedStop>& stops) {
  const Eigen::VectorXd start_q = pencil.q();
  std::vector<Pose<Color, Board>> tried;
  while (static_cast<int>(tried.size()) < most && !coverage.complete()) {
    const plan::NextView next =
        plan::nextView(coverage, belief, board, pencil.guard(), pencil.q(), start_q, tried, options);
    for (const int cell : next.unreachable) coverage.giveUp(cell);
    if (!next.view) return coverage.giveUpMarginals();
    tried.push_back(next.view->cdMo);
    if (next.view->via_start) (void)pencil.goTo("", start_q);
    stops.push_back(pencil.goTo(describe(stage, *next.view, cells_x), next.view->bMe));
    coverage.add(cornersIn(belief.camera, board, next.view->cdMo), next.view->cdMo);
  }
}

bool isLink(const std::string& body) { return body.rfind("link ", 0) == 0; }

coverage::Coverage sparse(CoverageConfig config, const CameraModel& camera, int cells_x, int cells_y,
                          int near_views, int far_views) {
  config.cells_x = cells_x;
  config.cells_y = cells_y;
  config.corners_per_cell = 6;
  coverage::ViewGoals goals;
  goals.near_views = near_views;
  goals.far_views = far_views;
  goals.views_per_tilt_bin = 0;
  return {config, ImageRegion{0, 0, camera.width_px, camera.height_px}, goals};
}

}  // namespace

double Pencil::travelS(const Pose<Base, EndEffector>& from, const Pose<Base, EndEffector>& to) const {
  const MotionLimits& limits = guard_.limits();
  const auto by = [](double way, double speed, double acceleration) {  // Ramps at both ends.
    return way * acceleration > speed * speed ? way / speed + speed / acceleration
                                              : 2.0 * std::sqrt(way / acceleration);
  };
  return std::max(
      by(distanceM(from, to), limits.max_speed_mps, limits.max_acceleration_mps2),
      by(angleRad(from, to), limits.max_angular_speed_radps, limits.max_angular_acceleration_radps2));
}

void Pencil::measure(PlannedStop& stop, const Eigen::VectorXd& q) const {
  stop.clearance_m = kFarEnoughM;
  for (const robot::CollisionModel::Gap& gap : bodies_.gaps(q)) {
    // How near the arm's own links are to each other tells nobody anything; that they do not touch, the guard
    // sees to.
    if (isLink(gap.a) && isLink(gap.b)) continue;
    if (gap.distance_m >= stop.clearance_m) continue;
    stop.clearance_m = std::max(0.0, gap.distance_m);
    stop.nearest = std::string(gap.a) + " and " + gap.b;
  }
  if (const auto reason = guard_.objection(q)) stop.objection = *reason;
}

PlannedStop Pencil::goTo(const std::string& what, const Eigen::VectorXd& q) {
  PlannedStop stop;
  stop.what = what;
  stop.bMe = guard_.kinematics().forward(q);
  measure(stop, q);
  if (stop.objection.empty()) {
    time_s_ += travelS(guard_.kinematics().forward(q_), stop.bMe) + kStopS;
    q_ = q;
  }
  stop.at_s = time_s_;
  return stop;
}

PlannedStop Pencil::goTo(const std::string& what, const Pose<Base, EndEffector>& bMe) {
  if (const auto q = guard_.kinematics().inverse(bMe, q_, guard_.limits().joint_margin_rad))
    return goTo(what, *q);
  PlannedStop stop;
  stop.what = what;
  stop.bMe = bMe;
  stop.at_s = time_s_;
  stop.objection = "The arm does not reach there.";
  return stop;
}

PlannedCamera planCamera(const CellConfig& cell, const CameraConfig& camera, const plan::Belief& belief,
                         Pencil& pencil) {
  const CoverageConfig& config = cell.coverage;
  const plan::PlanOptions options = plan::coveragePlan(config, belief.camera, 75 * kDegree);
  PlannedCamera planned;
  planned.camera = camera.name;
  const Pose<Color, Board> facing(Eigen::Matrix3d::Identity(), {0.0, 0.0, 1.1 * config.near_distance_m});
  const auto bMe = forMount(belief.mount, belief.bMc * facing * belief.eMo.inverse());
  planned.stops.push_back(
      pencil.goTo("tilt search: board facing it, turned step by step about its own centre", bMe));
  if (planned.stops.back().objection.empty()) {
    pencil.wait(kTiltStops * kStopS + kTiltTurnsDeg * kDegree / cell.limits.max_angular_speed_radps);
  }

  const ImageRegion region = camera.region.value_or(ImageRegion{0, 0, camera.width_px, camera.height_px});
  coverage::Coverage coverage(config, region);
  fill("cover", cell.board, belief, options, coverage, config.cells_x, config.max_views, pencil,
       planned.stops);
  planned.cells = coverage.cells();
  planned.cells_filled = coverage.filledCells();
  for (int i = 0; i < coverage.cells(); ++i) planned.cells_out_of_reach += coverage.givenUp(i);

  const int revisits = config.revisit_views;
  plan::PlanOptions upright = options;
  upright.tilt_rad = upright.roll_rad = 0.0;
  coverage::Coverage places = sparse(config, belief.camera, 3, 2, revisits / 2, revisits - revisits / 2);
  fill("revisit", cell.board, belief, upright, places, 3, revisits, pencil, planned.stops);

  plan::PlanOptions mild = options;
  mild.tilt_rad *= 0.6;
  coverage::Coverage checks = sparse(config, belief.camera, 2, 2, 0, config.check_views);
  fill("check", cell.board, belief, mild, checks, 2, config.check_views, pencil, planned.stops);
  return planned;
}

}  // namespace servocal::app
