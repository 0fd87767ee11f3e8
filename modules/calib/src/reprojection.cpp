// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/reprojection.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "hand_eye_fit.h"
#include "hand_eye_start.h"
#include "servocal/calib/board_pose.h"
#include "view_reasons.h"

namespace servocal::calib {
namespace {

/// RMS spread, about its mean, of the board pose that ought to be constant, the robot believed.
void fillScatter(const std::vector<Eigen::Isometry3d>& seen_rMo, HandEyeSolution& solution) {
  if (seen_rMo.empty()) return;
  std::vector<Vector6d> offsets;
  Vector6d mean = Vector6d::Zero();
  const auto reference = Pose<Base, Board>(solution.board_pose);
  for (const Eigen::Isometry3d& rMo : seen_rMo) {
    Vector6d offset;
    offset << rMo.translation() - reference.translation(),
        (reference.inverse() * Pose<Base, Board>(rMo)).rotationVector();
    offsets.push_back(offset);
    mean += offset / static_cast<double>(seen_rMo.size());
  }
  double squares_m2 = 0, squares_rad2 = 0;
  for (const Vector6d& offset : offsets) {
    squares_m2 += (offset - mean).head<3>().squaredNorm();
    squares_rad2 += (offset - mean).tail<3>().squaredNorm();
  }
  solution.scatter_m = std::sqrt(squares_m2 / offsets.size());
  solution.scatter_rad = std::sqrt(squares_rad2 / offsets.size());
}

void check(const ReprojectionOptions& options) {
  if (!(options.robot_sigma_m > 0) || !(options.robot_sigma_rad > 0) || !(options.huber_sigma > 0)) {
    throw std::invalid_argument("robot_sigma_m, robot_sigma_rad and huber_sigma must be positive");
  }
  if (options.start && options.start->mount != options.mount) {
    throw std::invalid_argument("the start solution is of another mount");
  }
}

/// One solve, step by step.
class Solve {
 public:
  Solve(const BoardSpec& board_spec, const CameraModel& model, const std::vector<Observation>& observations,
        const std::string& camera_name, Stream stream, const ReprojectionOptions& how)
      : board(board_spec), camera(model), options(how), problem(board, camera, options) {
    solution.mount = options.mount;
    for (const Observation& observation : observations) {
      if (!observation.robot) continue;
      for (const StreamObservation& view : observation.views) {
        if (view.camera != camera_name || view.stream != stream) continue;
        const Pose<Base, EndEffector>& bMe = observation.robot->bMe;
        if (!bMe.isFinite()) {
          throw std::invalid_argument("the robot pose of observation " + std::to_string(observation.id) +
                                      " is not finite");
        }
        const bool fixed = options.mount == Mount::kFixed;
        views.push_back({&view.detection, fixed ? bMe.isometry() : bMe.inverse().isometry(),
                         solution.views.size(), false});
        const std::string& file = view.image_file.empty() ? observation.stage : view.image_file;
        solution.views.push_back({observation.id, file, 0.0, true, ""});
      }
    }
    seen_cMo.resize(views.size());
    seen.assign(views.size(), false);
  }

  HandEyeOutcome run() {
    if (options.start && !fitFromStart()) return outcome;
    if (!hasConverged() && !fitFromClosedForm()) return outcome;
    outcome.status = HandEyeStatus::kNotConverged;
    if (!hasConverged()) return outcome;
    if (!solved->left_out.empty()) explain();  // With outliers kept, it need not converge: nobody relies on it.
    report();
    outcome.status = HandEyeStatus::kSolved;
    outcome.solution = std::move(solution);
    return outcome;
  }

 private:
  const BoardSpec& board;
  const CameraModel& camera;
  const ReprojectionOptions& options;
  HandEyeProblem problem;
  std::vector<HandEyeStop> views;
  std::vector<Eigen::Isometry3d> seen_cMo;  // per view, the pose of its image alone
  std::vector<bool> seen;
  std::vector<CandidateView> candidates;  // filled only where they are needed
  std::optional<GatedFit> solved;
  HandEyeSolution solution;
  HandEyeOutcome outcome;

  bool hasConverged() const { return solved.has_value() && solved->fit.converged; }

  void findCandidates() {
    for (const HandEyeStop& view : views) {
      candidates.push_back(
          candidateView(board, problem.turns(), camera, *view.detection, Pose<Base, EndEffector>(view.lMr)));
    }
  }

  /// From a solution that is near, where all views agree with it. False if the outcome is settled: no
  /// solution.
  bool fitFromStart() {
    std::vector<Eigen::Matrix3d> rotations;
    HandEyeState state{options.start->camera_pose, options.start->board_pose, {}};
    std::vector<HandEyeStop> started;
    for (HandEyeStop view : views) {
      std::optional<ViewCost> cost = problem.viewCost(state, view, Vector6d::Zero());
      for (int turn = 1; turn < problem.turns().count(*view.detection); ++turn) {
        HandEyeStop other = view;
        other.turn = turn;
        const std::optional<ViewCost> other_cost = problem.viewCost(state, other, Vector6d::Zero());
        if (other_cost && (!cost || other_cost->whitened < cost->whitened)) {
          view = other;
          cost = other_cost;
        }
      }
      const Pose<Color, Board> predicted(problem.boardPose(state, view, Vector6d::Zero()));
      const std::optional<BoardPose> pose =
          refineBoardPose(board, camera, problem.turns().turned(*view.detection, view.turn), predicted);
      // Only views near the prediction; the closed form sorts out the rest.
      if (!cost || !pose || distanceM(pose->cMo, predicted) > 0.05 * predicted.translation().norm()) continue;
      seen_cMo[view.report] = pose->cMo.isometry();
      seen[view.report] = true;
      started.push_back(view);
      state.corrections.push_back(Vector6d::Zero());
      rotations.push_back(view.lMr.linear());
    }
    if (started.size() == views.size() && started.size() >= 3) {
      outcome.axis_spread = axisSpread(rotations, options.closed_form.min_rotation_rad);
      if (outcome.axis_spread < options.closed_form.min_axis_spread) {
        outcome.status = HandEyeStatus::kRotationAxesParallel;
        return false;
      }
      solved = solveGated(problem, started, state, true);
      if (solved && solved->used.size() < 0.8 * views.size()) solved.reset();
    }
    return true;
  }

  /// From nothing. False if the outcome is settled: no solution.
  bool fitFromClosedForm() {
    findCandidates();
    HandEyeStart start = startHandEye(board, candidates, options.closed_form);
    outcome.status = start.status;
    outcome.axis_spread = start.axis_spread;
    if (start.status != HandEyeStatus::kSolved) return false;

    std::vector<HandEyeStop> left_out;
    for (int round = 0; round < 2; ++round) {
      HandEyeState state{start.bMc.isometry(), start.eMo.isometry(), {}};
      if (round > 0) state = {solved->fit.state.lMc, solved->fit.state.rMo, {}};
      std::vector<int> choice;
      for (const CandidateView& candidate : candidates) {
        choice.push_back(nearestCandidate(board, candidate, Pose<Base, Color>(state.lMc),
                                          Pose<EndEffector, Board>(state.rMo)));
      }
      if (round > 0 && choice == start.choice) break;  // the better estimate changes no mind
      start.choice = choice;
      std::vector<HandEyeStop> chosen;
      left_out.clear();
      for (std::size_t i = 0; i < views.size(); ++i) {
        HandEyeStop view = views[i];
        seen[i] = choice[i] >= 0;
        if (!seen[i]) {
          left_out.push_back(view);
          continue;
        }
        const BoardPoseCandidate& chosen_pose = candidates[i].candidates[static_cast<std::size_t>(choice[i])];
        view.turn = chosen_pose.turn;
        view.flipped = !chosen_pose.better_fitting;
        seen_cMo[i] = chosen_pose.cMo.isometry();
        chosen.push_back(view);
        state.corrections.push_back(Vector6d::Zero());
      }
      if (round == 0) problem.setScale(1.0);
      if (chosen.size() >= 3) solved = solveGated(problem, chosen, state, round > 0);
      if (chosen.size() < 3 || !solved) {
        outcome.status = HandEyeStatus::kInconsistent;
        return false;
      }
    }
    solved->left_out.insert(solved->left_out.end(), left_out.begin(), left_out.end());
    return true;
  }

  /// Why views were left out; with keep_outliers they come in again.
  void explain() {
    if (candidates.empty()) findCandidates();
    std::vector<Stop> stops;
    for (std::size_t i = 0; i < views.size(); ++i) {
      stops.push_back({views[i].detection, views[i].lMr, candidates[i].candidates});
    }
    for (const HandEyeStop& view : solved->left_out) solution.views[view.report].used = false;
    explainLeftOut(board, options.mount, solved->fit.state.lMc, solved->fit.state.rMo,
                   std::max(options.robot_sigma_m, 1e-3), stops, solution.views);
    if (options.keep_outliers) keepAll(board, problem, views, candidates, *solved, seen_cMo, seen);
  }

  void report() {
    // The same board, turned as the first view has it, if that would otherwise have to change its ids.
    const HandEyeState& state = solved->fit.state;
    const bool any_known = std::any_of(solved->used.begin(), solved->used.end(), [](const HandEyeStop& view) {
      return view.detection->orientation_known;
    });
    const int first_turn = any_known ? 0 : solved->used.front().turn;
    const Eigen::Isometry3d first_rotation = problem.turns().rotation(first_turn).isometry();
    solution.camera_pose = state.lMc;
    solution.board_pose = state.rMo * first_rotation;
    for (const HandEyeStop& view : solved->used) {
      const bool open = problem.turns().count(*view.detection) > 1;
      solution.symmetric_views += open ? 1 : 0;
      solution.resolved_turns += open && problem.turns().between(first_turn, view.turn) != 0 ? 1 : 0;
      solution.resolved_flips += view.flipped ? 1 : 0;
    }

    const Eigen::MatrixXd covariance = scaledInverse(reducedMatrix(solved->fit.system));
    const Eigen::VectorXd sigma = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
    solution.camera_sigma = sigma.head<6>();
    solution.board_sigma = sigma.tail<6>();

    double squares_px2 = 0, corners = 0, squares_m2 = 0, squares_rad2 = 0;
    std::vector<Eigen::Isometry3d> seen_rMo;
    for (std::size_t i = 0; i < solved->used.size(); ++i) {
      const HandEyeStop& view = solved->used[i];
      const Vector6d& correction = state.corrections[i];
      const std::optional<ViewCost> cost = problem.viewCost(state, view, correction);
      const auto count = static_cast<double>(view.detection->corners.size());
      solution.views[view.report].rms_px = cost->rms_px;
      squares_px2 += cost->rms_px * cost->rms_px * count;
      corners += count;
      squares_m2 += correction.head<3>().squaredNorm();
      squares_rad2 += correction.tail<3>().squaredNorm();
      if (seen[view.report]) {
        seen_rMo.push_back(view.lMr.inverse() * state.lMc * seen_cMo[view.report] * first_rotation);
      }
    }
    for (const HandEyeStop& view : solved->left_out) {
      const std::optional<ViewCost> cost = problem.viewCost(state, view, Vector6d::Zero());
      if (cost) solution.views[view.report].rms_px = cost->rms_px;
    }
    if (options.keep_outliers) {
      for (const HandEyeStop& view : solved->used) solution.views[view.report].used = true;
    }
    solution.rms_px = std::sqrt(squares_px2 / corners);
    solution.robot_rms_m = std::sqrt(squares_m2 / solved->used.size());
    solution.robot_rms_rad = std::sqrt(squares_rad2 / solved->used.size());
    fillScatter(seen_rMo, solution);
  }
};

}  // namespace

HandEyeOutcome solveHandEyeReprojection(const BoardSpec& board, const CameraModel& camera,
                                        const std::vector<Observation>& observations,
                                        const std::string& camera_name, Stream stream,
                                        const ReprojectionOptions& options) {
  check(options);
  return Solve(board, camera, observations, camera_name, stream, options).run();
}

}  // namespace servocal::calib
