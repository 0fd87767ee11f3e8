// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_prediction.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "joint_start.h"

namespace servocal::calib {
namespace {

/// The options under which a problem has the solution's parameters in the solution's order.
JointOptions optionsOf(const JointSolution& solution) {
  JointOptions options;
  options.mount = solution.mount;
  options.board = solution.board_freedom;
  options.robot_terms = solution.robot_model;
  options.robot_sigma_m = solution.robot.sigma_m;
  options.robot_sigma_rad = solution.robot.sigma_rad;
  options.huber_sigma = INFINITY;
  for (const JointCamera& camera : solution.cameras) {
    JointStream stream;
    stream.camera = camera.camera;
    stream.stream = camera.stream;
    stream.lens = camera.model.lens;
    stream.prior = camera.prior;
    const std::vector<std::string>& names = parameterNames(stream.lens);
    for (std::size_t p = 0; p < names.size(); ++p) {
      const bool is_free =
          std::find(camera.free.begin(), camera.free.end(), static_cast<int>(p)) != camera.free.end();
      if (!is_free) stream.fixed.push_back(names[p]);
    }
    options.streams.push_back(stream);
  }
  return options;
}

}  // namespace

JointPrediction::JointPrediction(const BoardSpec& board, const std::vector<Observation>& observations,
                                 const JointSolution& solution)
    : options_(optionsOf(solution)), problem_(board, options_, jointStops(observations, options_)) {
  for (const JointCamera& camera : solution.cameras) state_.cameras.push_back({camera.model, camera.pose});
  state_.rMo = solution.board_pose;
  state_.shape = solution.board;
  state_.terms = solution.robot_terms;
  state_.corrections.assign(problem_.stops().size(), Vector6d::Zero());
  JointNoise noise{solution.robot.sigma_m, solution.robot.sigma_rad, {}};
  for (const JointCamera& camera : solution.cameras) noise.corner_scale.push_back(camera.corner_scale);
  problem_.setNoise(noise);
  problem_.setViews(jointViews(problem_, state_));
}

void JointPrediction::restore(const JointSolution& solution) {
  std::map<std::int64_t, const StopCorrection*> stops;
  for (const StopCorrection& stop : solution.stops) stops[stop.observation_id] = &stop;
  for (std::size_t i = 0; i < problem_.stops().size(); ++i) {
    const auto found = stops.find(problem_.stops()[i].observation->id);
    if (found == stops.end()) continue;
    state_.corrections[i] = found->second->correction;
    if (state_.terms.size() > 0) state_.corrections[i] -= problem_.stops()[i].by_terms * state_.terms;
  }
  std::vector<JointView> used;
  for (const JointView& view : problem_.views()) {
    const std::int64_t id = problem_.stops()[view.stop].observation->id;
    const std::vector<ViewResidual>& reports = solution.cameras[view.camera].views;
    const bool in_use = std::any_of(reports.begin(), reports.end(), [&](const ViewResidual& report) {
      return report.observation_id == id && report.used;
    });
    if (in_use) used.push_back(view);
  }
  problem_.setViews(std::move(used));
}

}  // namespace servocal::calib
