// SPDX-License-Identifier: GPL-3.0-or-later
#include "hand_eye_fit.h"

#include <algorithm>
#include <cmath>

#include "median.h"
#include "servocal/calib/board_pose.h"

namespace servocal::calib {
namespace {

std::optional<HandEyeFit> minimize(const HandEyeProblem& problem, const HandEyeState& start, int iterations,
                                   double tolerance) {
  return minimizeArrow(
      start, [&](const HandEyeState& state) { return problem.linearize(state); },
      [&](const HandEyeState& state, const ArrowStep& step) { return problem.move(state, step); }, iterations,
      tolerance);
}

/// Per view, the square root of its chi-square per degree of freedom.
std::vector<double> viewScales(const HandEyeProblem& problem, const HandEyeState& state) {
  double rows = 0;
  for (const HandEyeStop& view : problem.views()) rows += 2.0 * view.detection->corners.size();
  const double free_share = std::max(0.2, 1.0 - 12.0 / rows);
  std::vector<double> scales;
  for (std::size_t i = 0; i < problem.views().size(); ++i) {
    const HandEyeStop& view = problem.views()[i];
    const std::optional<ViewCost> cost = problem.viewCost(state, view, state.corrections[i]);
    const double degrees = 2.0 * view.detection->corners.size() * free_share;
    scales.push_back(cost ? std::sqrt(cost->whitened / degrees) : INFINITY);
  }
  return scales;
}

/// Minimizes with the scale of the corner noise set so that the typical view has a chi-square of one per
/// degree of freedom. From afar it starts with a scale that is too large: the robot is believed first, and
/// what it cannot explain tells the noise.
std::optional<HandEyeFit> minimizeWithScale(HandEyeProblem& problem, const HandEyeState& start,
                                            bool start_is_close) {
  constexpr double kLeastScale = 0.2;  // claimed covariances that much too large are believed no further
  HandEyeState state = start;
  for (int round = start_is_close ? 1 : 0; round < 12; ++round) {
    if (round != 1 || !start_is_close) {
      const double scale = std::max(kLeastScale, problem.scale() * median(viewScales(problem, state)));
      if (!std::isfinite(scale)) return std::nullopt;
      const bool settled = std::abs(scale / problem.scale() - 1.0) < 0.01;
      problem.setScale(scale);
      if (settled && round > 0) break;
    }
    const std::optional<HandEyeFit> fit = minimize(problem, state, 2, 1e-4);
    if (!fit) return std::nullopt;
    state = fit->state;
  }
  return minimize(problem, state, 60, 1e-13);
}

std::vector<double> correctionNorms(const HandEyeProblem& problem, const HandEyeState& state) {
  std::vector<double> norms;
  for (const Vector6d& correction : state.corrections) norms.push_back(problem.whitened(correction).norm());
  return norms;
}

/// In a small set one wrong robot pose bends the solution until all stops share its error. Where a correction
/// is beyond chance, believes each stop the less the more correction it needs and solves again, until the
/// error is back where it belongs. The state is for finding outliers only.
///
/// Source: iteratively reweighted least squares with the weights of Geman & McClure, 1987.
HandEyeState withoutSmear(HandEyeProblem& problem, HandEyeState state) {
  constexpr double kBeyondChance = 5.5;  // of 6 numbers of unit variance: 1 in 40000
  std::vector<double> norms = correctionNorms(problem, state);
  for (int round = 0; round < 10; ++round) {
    if (*std::max_element(norms.begin(), norms.end()) < kBeyondChance) break;
    const double scale = std::max(kBeyondChance, 1.5 * median(norms));
    std::vector<double> belief;
    for (const double norm : norms) belief.push_back(std::pow(1.0 / (1.0 + std::pow(norm / scale, 2)), 2));
    problem.setBelief(belief);
    const std::optional<HandEyeFit> fit = minimize(problem, state, 4, 1e-4);
    if (!fit) break;
    state = fit->state;
    norms = correctionNorms(problem, state);
  }
  problem.setBelief(std::vector<double>(norms.size(), 1.0));
  return state;
}

/// Views that stand out beyond the spread of the others. Never so many that the rest says nothing.
std::vector<bool> outliers(const HandEyeProblem& problem, const HandEyeState& state) {
  const std::vector<double> scales = viewScales(problem, state);
  // Below one only where corners are better than claimed beyond all belief (noiseless input): no outliers.
  const double middle = std::max(1.0, median(scales));
  std::vector<double> deviations;
  for (double scale : scales) deviations.push_back(std::abs(scale - middle));
  const double spread = 1.4826 * median(deviations);
  // What a robot pose lacks shows in its correction, however many corners dilute it in the view's sum: six
  // numbers of unit variance, or of what this robot usually needs.
  const std::vector<double> corrections = correctionNorms(problem, state);
  const double correction_limit = std::max(8.0, 4.0 * median(corrections));
  // Six standard deviations of the views as they scatter; at least what chance does to a chi-square of
  // this many degrees, and at least twice the typical view: model error makes views unequal.
  const double limit = std::max(2.0 * middle, middle + 6.0 * spread);
  std::vector<bool> out;
  for (std::size_t i = 0; i < scales.size(); ++i) {
    const double degrees = 2.0 * problem.views()[i].detection->corners.size();
    out.push_back(scales[i] > std::max(limit, middle * (1.0 + 4.0 / std::sqrt(degrees))) ||
                  corrections[i] > correction_limit);
  }
  return out;
}

std::size_t countTrue(const std::vector<bool>& values) {
  return static_cast<std::size_t>(std::count(values.begin(), values.end(), true));
}

}  // namespace

std::optional<GatedFit> solveGated(HandEyeProblem& problem, const std::vector<HandEyeStop>& views,
                                   const HandEyeState& start, bool start_is_close) {
  GatedFit solved{HandEyeFit{start, ArrowSystem(12, 0), false, 0}, views, {}};
  HandEyeState state = start;
  for (int round = 0; round < 6; ++round) {
    problem.setViews(solved.used);
    std::optional<HandEyeFit> fit = minimizeWithScale(problem, state, start_is_close || round > 0);
    if (!fit) return std::nullopt;
    solved.fit = *std::move(fit);
    const std::vector<bool> out = outliers(problem, withoutSmear(problem, solved.fit.state));
    if (countTrue(out) == 0 || solved.used.size() - countTrue(out) < 3) break;
    state = {solved.fit.state.lMc, solved.fit.state.rMo, {}};
    std::vector<HandEyeStop> kept;
    for (std::size_t i = 0; i < out.size(); ++i) {
      if (out[i]) {
        solved.left_out.push_back(solved.used[i]);
      } else {
        kept.push_back(solved.used[i]);
        state.corrections.push_back(solved.fit.state.corrections[i]);
      }
    }
    solved.used = std::move(kept);
  }
  return solved;
}

void keepAll(const BoardSpec& board, HandEyeProblem& problem, const std::vector<HandEyeStop>& views,
             const std::vector<CandidateView>& candidates, GatedFit& solved,
             std::vector<Eigen::Isometry3d>& seen_cMo, std::vector<bool>& seen) {
  HandEyeState state{solved.fit.state.lMc, solved.fit.state.rMo, {}};
  std::vector<HandEyeStop> all;
  for (std::size_t i = 0; i < views.size(); ++i) {
    HandEyeStop view = views[i];
    const Pose<Color, Board> predicted(problem.boardPose(state, view, Vector6d::Zero()));
    double least_m = INFINITY;
    for (const BoardPoseCandidate& candidate : candidates[i].candidates) {
      const double distance_m = cornerDistance(board, predicted, candidate.cMo);
      if (distance_m >= least_m) continue;
      least_m = distance_m;
      view.turn = candidate.turn;
      view.flipped = !candidate.better_fitting;
      seen_cMo[i] = candidate.cMo.isometry();
    }
    seen[i] = std::isfinite(least_m);
    // A board that would have to be behind the camera cannot be kept.
    if (!seen[i] || !problem.viewCost(state, view, Vector6d::Zero())) continue;
    all.push_back(view);
    state.corrections.push_back(Vector6d::Zero());
  }
  problem.setViews(all);
  if (auto fit = minimizeWithScale(problem, state, false)) solved = {*std::move(fit), std::move(all), {}};
}

}  // namespace servocal::calib
