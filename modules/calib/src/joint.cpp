// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/joint.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "joint_gate.h"
#include "joint_noise.h"
#include "joint_open.h"
#include "joint_problem.h"
#include "joint_report.h"
#include "joint_start.h"

namespace servocal::calib {
namespace {

void check(const JointOptions& options) {
  const auto positive = [](double value, const char* name) {
    if (!(value > 0) || !std::isfinite(value))
      throw std::invalid_argument(std::string(name) + " must be positive");
  };
  positive(options.robot_sigma_m, "robot_sigma_m");
  positive(options.robot_sigma_rad, "robot_sigma_rad");
  positive(options.huber_sigma, "huber_sigma");
  positive(options.undetermined_share, "undetermined_share");
  positive(options.board.scale_sigma, "board.scale_sigma");
  positive(options.board.bow_sigma_m, "board.bow_sigma_m");
  if (!options.robot_terms) return;
  const RobotTerms& terms = *options.robot_terms;
  if (terms.prior_sigma.size() != static_cast<Eigen::Index>(terms.names.size()) || !terms.jacobian ||
      !(terms.prior_sigma.array() > 0).all()) {
    throw std::invalid_argument(
        "robot_terms need a name, a positive prior_sigma and a column of the Jacobian each");
  }
}

std::vector<Observation> sorted(std::vector<Observation> observations) {
  std::stable_sort(observations.begin(), observations.end(),
                   [](const Observation& a, const Observation& b) { return a.id < b.id; });
  return observations;
}

/// All streams that are asked for, or all there are, in an order of their own.
std::vector<JointStream> streamsOf(const std::vector<Observation>& observations,
                                   const JointOptions& options) {
  std::vector<JointStream> streams = options.streams;
  if (streams.empty()) {
    std::set<std::pair<std::string, Stream>> found;
    for (const Observation& observation : observations) {
      for (const StreamObservation& view : observation.views) {
        if (view.stream != Stream::kDepth) found.insert({view.camera, view.stream});
      }
    }
    for (const auto& [camera, stream] : found) {
      streams.emplace_back();
      streams.back().camera = camera;
      streams.back().stream = stream;
    }
  }
  std::sort(streams.begin(), streams.end(), [](const JointStream& a, const JointStream& b) {
    return std::make_pair(a.camera, a.stream) < std::make_pair(b.camera, b.stream);
  });
  return streams;
}

std::optional<JointFit> minimize(const JointProblem& problem, const JointState& start, int iterations,
                                 double tolerance) {
  return minimizeArrow(
      start, [&](const JointState& state) { return problem.linearize(state); },
      [&](const JointState& state, const ArrowStep& step) { return problem.move(state, step); }, iterations,
      tolerance);
}

std::vector<JointView> inUse(const std::vector<JointViewStart>& views) {
  std::vector<JointView> out;
  for (const JointViewStart& start : views) {
    if (start.used) out.push_back(start.view);
  }
  return out;
}

/// At least three views of every camera are left.
bool enough(const JointProblem& problem, const std::vector<JointViewStart>& views,
            const std::vector<bool>& stays) {
  std::vector<int> left(problem.layout().cameras.size(), 0);
  for (std::size_t i = 0; i < views.size(); ++i) left[views[i].view.camera] += stays[i] ? 1 : 0;
  return std::all_of(left.begin(), left.end(), [](int count) { return count >= 3; });
}

bool settled(const JointNoise& before, const JointNoise& after) {
  constexpr double kEnough = 0.01;
  const auto same = [](double a, double b) { return std::abs(a / b - 1.0) < kEnough; };
  bool all = same(before.robot_m, after.robot_m) && same(before.robot_rad, after.robot_rad) &&
             same(before.terms_scale, after.terms_scale);
  for (std::size_t k = 0; k < before.corner_scale.size(); ++k) {
    all = all && same(before.corner_scale[k], after.corner_scale[k]);
  }
  return all;
}

/// Minimizes, estimates the noise, judges the views, until none of them changes.
std::optional<JointSolved> solveRounds(JointProblem& problem, const JointState& start,
                                       std::vector<JointViewStart>& views) {
  constexpr int kMostRounds = 15, kLastJudgement = 6;
  const JointOptions& options = problem.options();
  JointState state = start;
  for (int round = 0; round < kMostRounds; ++round) {
    problem.setViews(inUse(views));
    if (round == 0 && options.estimate_noise) {
      problem.setNoise({std::max(options.robot_sigma_m, kLooseRobotM),
                        std::max(options.robot_sigma_rad, kLooseRobotRad),
                        typicalCornerScales(problem, state)});
    }
    const std::optional<JointFit> fit = minimize(problem, state, 3, 1e-4);
    if (!fit) return std::nullopt;
    state = fit->state;
    JointNoise noise = varianceComponents(problem, state, fit->system).noise;
    if (round == 0)
      noise = {problem.noise().robot_m, problem.noise().robot_rad, typicalCornerScales(problem, state)};
    if (!options.estimate_noise) noise = problem.noise();
    bool done = settled(problem.noise(), noise) && round > 0;
    problem.setNoise(noise);
    if (round <= kLastJudgement) {
      const std::vector<bool> stays = judgeViews(problem, state, views);
      if (enough(problem, views, stays)) {
        for (std::size_t i = 0; i < views.size(); ++i) {
          done = done && views[i].used == stays[i];
          views[i].used = stays[i];
        }
      }
    }
    if (done) break;
  }
  problem.setViews(inUse(views));
  std::optional<JointFit> fit = minimize(problem, state, 60, 1e-13);
  if (!fit) return std::nullopt;
  NoiseEstimate last = varianceComponents(problem, fit->state, fit->system);
  last.noise = problem.noise();
  return JointSolved{*std::move(fit), std::move(last)};
}

}  // namespace

const char* toString(JointStatus status) {
  switch (status) {
    case JointStatus::kSolved: return "Solved.";
    case JointStatus::kTooFewViews:
      return "Too few views of the board with a robot pose. Every camera needs at least three.";
    case JointStatus::kRotationAxesParallel:
      return "The robot rotated about one axis only, which leaves the cameras' place along it open. Add "
             "views with "
             "the flange turned about other axes, by 20 degrees or more.";
    case JointStatus::kNotDetermined:
      return "The views leave something open that the result cannot do without; it is named.";
    case JointStatus::kInconsistent:
      return "Robot poses and images contradict each other. Check that they belong together, units and "
             "direction of "
             "the poses, the size of the board, and that board and cameras are fastened.";
    case JointStatus::kNotConverged:
      return "The solve did not converge. Look for wrong detections; hold distortion terms fixed if views "
             "are few.";
  }
  return "Unknown status.";
}

JointOutcome solveJoint(const BoardSpec& board, const std::vector<Observation>& unsorted,
                        const JointOptions& given) {
  check(given);
  const std::vector<Observation> observations = sorted(unsorted);
  JointOptions options = given;
  options.streams = streamsOf(observations, given);
  JointProblem problem(board, options, jointStops(observations, options));

  JointOutcome outcome;
  JointStart start = startJoint(board, observations, problem);
  outcome.status = start.status;
  outcome.axis_spread = start.axis_spread;
  if (start.status != JointStatus::kSolved) return outcome;
  std::vector<JointViewStart>& views = start.views;
  std::vector<bool> stays;
  for (const JointViewStart& view : views) stays.push_back(view.used);
  if (!enough(problem, views, stays)) {
    outcome.status = JointStatus::kTooFewViews;
    return outcome;
  }
  std::optional<JointSolved> solved = solveRounds(problem, start.state, views);
  if (!solved || !solved->fit.converged) {
    outcome.status = JointStatus::kNotConverged;
    return outcome;
  }
  const auto used =
      std::count_if(views.begin(), views.end(), [](const JointViewStart& view) { return view.used; });
  if (2 * static_cast<std::size_t>(used) < views.size()) {
    outcome.status = JointStatus::kInconsistent;
    return outcome;
  }

  const JointState& state = solved->fit.state;
  const JointLayout& layout = problem.layout();
  const JointCovariance anchored(solved->fit.system);
  JointSolution solution;
  solution.open = openDirections(problem, state, anchored.shared());
  const std::vector<bool> is_open = undetermined(problem, state, anchored.shared());
  for (std::size_t k = 0; k < layout.cameras.size(); ++k) {
    const JointLayout::Camera& camera = layout.cameras[k];
    for (int p = 0; p < camera.size(); ++p) {
      const bool distortion =
          p < static_cast<int>(camera.free.size()) && camera.free[static_cast<std::size_t>(p)] >= 4;
      if (is_open[static_cast<std::size_t>(camera.at + p)] && !distortion)
        outcome.status = JointStatus::kNotDetermined;
    }
  }
  for (int i = 0; i < 6; ++i) {
    if (is_open[static_cast<std::size_t>(layout.board_at + i)]) outcome.status = JointStatus::kNotDetermined;
  }
  if (outcome.status == JointStatus::kNotDetermined) {
    outcome.open = std::move(solution.open);
    return outcome;
  }

  solution.mount = options.mount;
  solution.board_pose = state.rMo;
  solution.board = state.shape;
  solution.robot_terms = state.terms;
  solution.names = problem.names();
  solution.board_at = layout.board_at;
  solution.shape_at = layout.shape_at;
  solution.robot_at = layout.terms_at;
  solution.board_freedom = options.board;
  solution.robot_model = options.robot_terms;
  if (solution.robot_model) solution.robot_model->prior_sigma *= problem.noise().terms_scale;
  solution.covariance = anchored.shared();
  solution.sigma = solution.covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  const Eigen::VectorXd scales = problem.scales(state);
  for (Eigen::Index i = 0; i < layout.size; ++i) {
    if (!is_open[static_cast<std::size_t>(i)]) continue;
    constexpr double kUnbounded = 3.0;  // of what is known beforehand
    if (solution.sigma[i] > kUnbounded * scales[i]) {
      solution.covariance.row(i).setConstant(NAN);
      solution.covariance.col(i).setConstant(NAN);
    }
    solution.sigma[i] = NAN;
  }
  reportCameras(board, problem, *solved, views, solution);
  reportRobot(problem, *solved, anchored, solution);
  outcome.solution = std::move(solution);
  return outcome;
}

}  // namespace servocal::calib
