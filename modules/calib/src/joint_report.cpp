// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "hand_eye_start.h"
#include "view_reasons.h"

namespace servocal::calib {
namespace {

/// Names what was left out, camera by camera.
void explain(const BoardSpec& board, const JointProblem& problem, const JointState& state,
             const std::vector<JointViewStart>& views, std::vector<JointCamera>& cameras) {
  const bool fixed = problem.options().mount == Mount::kFixed;
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    std::vector<ViewResidual>& reports = cameras[k].views;
    if (std::all_of(reports.begin(), reports.end(), [](const ViewResidual& view) { return view.used; }))
      continue;
    const std::vector<ViewResidual> before = reports;
    std::vector<Stop> stops;
    for (const JointViewStart& start : views) {
      if (start.view.camera != k) continue;
      const Eigen::Isometry3d& bMe = problem.stops()[start.view.stop].bMe;
      const Eigen::Isometry3d lMr = fixed ? bMe : bMe.inverse();
      stops.push_back({start.view.detection, lMr,
                       candidateView(board, problem.turns(), state.cameras[k].model, *start.view.detection,
                                     Pose<Base, EndEffector>(lMr))
                           .candidates});
    }
    const double tolerance_m = std::max(problem.options().robot_sigma_m, 1e-3);
    explainLeftOut(board, problem.options().mount, state.cameras[k].lMc, state.rMo, tolerance_m, stops,
                   reports);
    for (std::size_t i = 0; i < reports.size(); ++i) {
      if (before[i].cause != ViewCause::kNone) reports[i] = before[i];
    }
  }
}

}  // namespace

void reportCameras(const BoardSpec& board, const JointProblem& problem, const JointSolved& solved,
                   const std::vector<JointViewStart>& views, JointSolution& solution) {
  const JointState& state = solved.fit.state;
  const JointLayout& layout = problem.layout();
  for (std::size_t k = 0; k < layout.cameras.size(); ++k) {
    const JointStream& stream = problem.options().streams[k];
    JointCamera camera;
    camera.camera = stream.camera;
    camera.stream = stream.stream;
    camera.model = state.cameras[k].model;
    camera.pose = state.cameras[k].lMc;
    camera.intrinsics_at = layout.cameras[k].at;
    camera.pose_at = layout.cameras[k].poseAt();
    camera.free = layout.cameras[k].free;
    camera.prior = stream.prior;
    camera.corner_scale = problem.noise().corner_scale[k];
    camera.chi_square = solved.noise.chi_square[k];
    double squares_px2 = 0, corners = 0;
    for (const JointViewStart& start : views) {
      if (start.view.camera != k) continue;
      const JointView& view = start.view;
      ViewResidual report{
          problem.stops()[view.stop].observation->id, start.name, 0.0, start.used, start.reason, start.cause};
      const Eigen::Isometry3d cMo = problem.boardPose(
          state, view, start.used ? problem.correction(state, view.stop) : Vector6d(Vector6d::Zero()));
      double squares = 0;
      for (const Corner& corner : view.detection->corners) {
        const auto pixel = camera.model.project(cMo * problem.point(state, corner.id, view.turn));
        squares += pixel ? (*pixel - corner.pixel).squaredNorm() : INFINITY;
      }
      const auto count = static_cast<double>(view.detection->corners.size());
      report.rms_px = std::sqrt(squares / count);
      if (start.used) {
        report.reason.clear();
        report.cause = ViewCause::kNone;
        squares_px2 += squares;
        corners += count;
      }
      camera.views.push_back(std::move(report));
    }
    camera.rms_px = corners > 0 ? std::sqrt(squares_px2 / corners) : 0.0;
    solution.cameras.push_back(std::move(camera));
  }
  explain(board, problem, state, views, solution.cameras);
}

void reportRobot(const JointProblem& problem, const JointSolved& solved, const JointCovariance& covariance,
                 JointSolution& solution) {
  const JointOptions& options = problem.options();
  const JointNoise& noise = problem.noise();
  solution.robot = {noise.robot_m, noise.robot_rad, options.robot_sigma_m, options.robot_sigma_rad, 0.0, 0.0};
  if (options.estimate_noise) {
    if (solved.noise.degrees_m >= kLeastDegrees) solution.robot.degrees_m = solved.noise.degrees_m;
    if (solved.noise.degrees_rad >= kLeastDegrees) solution.robot.degrees_rad = solved.noise.degrees_rad;
  }
  std::set<std::size_t> heard;
  for (const JointView& view : problem.views()) heard.insert(view.stop);
  for (const std::size_t i : heard) {
    StopCorrection stop;
    stop.observation_id = problem.stops()[i].observation->id;
    stop.correction = problem.correction(solved.fit.state, i);
    stop.sigma = covariance.ofStop(i).diagonal().cwiseMax(0.0).cwiseSqrt();
    solution.stops.push_back(stop);
  }
  constexpr double kWorthANote = 2.0;
  const auto note = [&](double estimated, double declared, double degrees, double unit, const char* what) {
    if (degrees <= 0 || (estimated < kWorthANote * declared && estimated > declared / kWorthANote)) return;
    char text[200];
    std::snprintf(
        text, sizeof text,
        "by the images the robot's %s errs by %.3g per axis, not by the declared %.3g; the former was used",
        what, unit * estimated, unit * declared);
    solution.notes.emplace_back(text);
  };
  note(noise.robot_m, options.robot_sigma_m, solution.robot.degrees_m, 1e3, "position (mm)");
  note(noise.robot_rad, options.robot_sigma_rad, solution.robot.degrees_rad, 180.0 / M_PI,
       "orientation (degrees)");
  const double scale = noise.terms_scale;
  if (scale >= kWorthANote || scale <= 1.0 / kWorthANote) {
    char text[160];
    std::snprintf(
        text, sizeof text,
        "by the images the errors of the robot's geometry are %.2g times what is declared; that was used",
        scale);
    solution.notes.emplace_back(text);
  }
}

}  // namespace servocal::calib
