// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/reprojection.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "arrow.h"
#include "board_turns.h"
#include "corner_weight.h"
#include "hand_eye_start.h"
#include "median.h"
#include "servocal/calib/board_pose.h"
#include "view_reasons.h"

namespace servocal::calib {
namespace {

// One code for both mounts. l is the frame the camera stands in (fixed: base, flange: end effector), r the
// frame that holds the board; lMr is bMe or its inverse. The solution is lMc and rMo.

struct View {
  const BoardDetection* detection = nullptr;
  Eigen::Isometry3d lMr;
  std::size_t report = 0;  // index into HandEyeSolution::views
  int turn = 0;            // the corner ids are read as those of this turn of the board
  bool flipped = false;    // the worse fitting one of the plane's two poses was chosen
};

struct State {
  Eigen::Isometry3d lMc;
  Eigen::Isometry3d rMo;
  std::vector<Vector6d> corrections;  // of the flange: displacement (m), rotation vector (rad), its axes
};

/// The pose after a displacement of its origin and a turn about it, along the axes of the left frame.
Eigen::Isometry3d movedAboutOrigin(const Eigen::Isometry3d& pose, const Eigen::Ref<const Vector6d>& step) {
  Eigen::Isometry3d out = pose;
  out.linear() = rotationExp(step.tail<3>()) * pose.linear();
  out.translation() += step.head<3>();
  return out;
}

/// Residuals of one view.
struct ViewCost {
  double whitened = 0.0;  // robust, the correction's prior included
  double rms_px = 0.0;
};

class Problem {
 public:
  Problem(const BoardSpec& board, const CameraModel& camera, const ReprojectionOptions& options)
      : camera_(camera), options_(options), points_o_(board.corners()), turns_(board) {
    prior_root_ << Eigen::Vector3d::Constant(1.0 / options.robot_sigma_m),
        Eigen::Vector3d::Constant(1.0 / options.robot_sigma_rad);
  }

  void setViews(std::vector<View> views) {
    views_ = std::move(views);
    belief_.assign(views_.size(), 1.0);
    weights_.clear();
    for (const View& view : views_) {
      weights_.emplace_back();
      for (const Corner& corner : view.detection->corners) weights_.back().push_back(whitening(corner));
    }
  }
  /// How far each stop's robot pose is believed, 0 to 1; all alike until the next setViews.
  void setBelief(std::vector<double> belief) { belief_ = std::move(belief); }
  const std::vector<View>& views() const { return views_; }
  const BoardTurns& turns() const { return turns_; }
  void setScale(double scale) { scale_ = scale; }
  double scale() const { return scale_; }

  std::optional<ArrowSystem> linearize(const State& state) const {
    ArrowSystem system(12, static_cast<int>(views_.size()));
    const Eigen::Matrix3d cRl = state.lMc.linear().transpose();
    const bool fixed = options_.mount == Mount::kFixed;
    ProjectionJacobian derivative;
    Eigen::MatrixXd jacobian;
    Eigen::VectorXd residual;
    double robust_excess = 0;  // robust cost minus the weighted squares that stand for it
    for (std::size_t i = 0; i < views_.size(); ++i) {
      const View& view = views_[i];
      const Eigen::Vector3d shift = state.corrections[i].head<3>(), turn = state.corrections[i].tail<3>();
      const Eigen::Matrix3d correction = rotationExp(turn), turn_jacobian = rightJacobian(turn);
      const Eigen::Matrix3d lRr = view.lMr.linear();
      const Eigen::Matrix3d l_by_r = fixed ? lRr * correction : correction * lRr;
      const Eigen::Matrix3d l_by_e = fixed ? lRr : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
      const std::vector<Corner>& corners = view.detection->corners;
      const Eigen::Index rows = 2 * static_cast<Eigen::Index>(corners.size());
      jacobian.resize(rows + 6, 18);
      residual.resize(rows + 6);
      for (std::size_t k = 0; k < corners.size(); ++k) {
        const Eigen::Vector3d arm_r = state.rMo.linear() * pointOf(view, corners[k]);
        const Eigen::Vector3d point_r = arm_r + state.rMo.translation();
        const Eigen::Vector3d point_e = fixed ? point_r : Eigen::Vector3d(view.lMr * point_r);
        const Eigen::Vector3d corrected_e = correction * point_e + shift;
        const Eigen::Vector3d point_l = fixed ? Eigen::Vector3d(view.lMr * corrected_e) : corrected_e;
        const Eigen::Vector3d arm_l = point_l - state.lMc.translation();
        const std::optional<Eigen::Vector2d> pixel = camera_.project(cRl * arm_l, derivative);
        if (!pixel) return std::nullopt;

        Eigen::Matrix2d weight = weights_[i][k] / scale_;
        const Eigen::Vector2d error = *pixel - corners[k].pixel;
        const double length = (weight * error).norm();
        if (length > options_.huber_sigma) {
          const double squares = options_.huber_sigma * length;
          robust_excess += options_.huber_sigma * (2.0 * length - options_.huber_sigma) - squares;
          weight *= std::sqrt(options_.huber_sigma / length);
        }
        const Eigen::Index row = 2 * static_cast<Eigen::Index>(k);
        residual.segment<2>(row) = weight * error;
        const Eigen::Matrix<double, 2, 3> by_l = weight * derivative.point * cRl;
        const Eigen::Matrix<double, 2, 3> by_r = by_l * l_by_r, by_e = by_l * l_by_e;
        jacobian.block<2, 3>(row, 0) = -by_l;
        jacobian.block<2, 3>(row, 3) = by_l * skew(arm_l);
        jacobian.block<2, 3>(row, 6) = by_r;
        jacobian.block<2, 3>(row, 9) = -by_r * skew(arm_r);
        jacobian.block<2, 3>(row, 12) = by_e;
        jacobian.block<2, 3>(row, 15) = -by_e * correction * skew(point_e) * turn_jacobian;
      }
      jacobian.bottomRows<6>().setZero();
      const Vector6d prior_root = std::sqrt(belief_[i]) * prior_root_;
      jacobian.bottomRightCorner<6, 6>() = prior_root.asDiagonal();
      residual.tail<6>() = prior_root.cwiseProduct(state.corrections[i]);
      system.add(static_cast<int>(i), jacobian, residual);
    }
    system.cost += robust_excess;
    return system;
  }

  State move(const State& state, const ArrowStep& step) const {
    State out{movedAboutOrigin(state.lMc, step.shared.head<6>()),
              movedAboutOrigin(state.rMo, step.shared.tail<6>()), state.corrections};
    for (std::size_t i = 0; i < out.corrections.size(); ++i) out.corrections[i] += step.blocks[i];
    return out;
  }

  /// Nothing if a corner cannot be projected.
  std::optional<ViewCost> viewCost(const State& state, const View& view, const Vector6d& correction) const {
    ViewCost cost;
    cost.whitened = prior_root_.cwiseProduct(correction).squaredNorm();
    double squares_px2 = 0;
    const Eigen::Isometry3d cMo = boardPose(state, view, correction);
    for (const Corner& corner : view.detection->corners) {
      const std::optional<Eigen::Vector2d> pixel = camera_.project(cMo * pointOf(view, corner));
      if (!pixel) return std::nullopt;
      const Eigen::Vector2d error = *pixel - corner.pixel;
      const double length = (whitening(corner) * error).norm() / scale_;
      cost.whitened += length <= options_.huber_sigma
                           ? length * length
                           : options_.huber_sigma * (2.0 * length - options_.huber_sigma);
      squares_px2 += error.squaredNorm();
    }
    cost.rms_px = std::sqrt(squares_px2 / view.detection->corners.size());
    return cost;
  }

  /// A correction in standard deviations of the robot.
  Vector6d whitened(const Vector6d& correction) const { return prior_root_.cwiseProduct(correction); }

  /// cMo of a view with its stop corrected.
  Eigen::Isometry3d boardPose(const State& state, const View& view, const Vector6d& correction) const {
    Eigen::Isometry3d flange = Eigen::Isometry3d::Identity();
    flange.linear() = rotationExp(correction.tail<3>());
    flange.translation() = correction.head<3>();
    const Eigen::Isometry3d lMr =
        options_.mount == Mount::kFixed ? view.lMr * flange : flange * view.lMr;
    return state.lMc.inverse() * lMr * state.rMo;
  }

 private:
  const Eigen::Vector3d& pointOf(const View& view, const Corner& corner) const {
    return points_o_[static_cast<std::size_t>(turns_.id(corner.id, view.turn))];
  }

  const CameraModel& camera_;
  const ReprojectionOptions& options_;
  std::vector<Eigen::Vector3d> points_o_;
  BoardTurns turns_;
  Vector6d prior_root_;
  std::vector<View> views_;
  std::vector<double> belief_;
  std::vector<std::vector<Eigen::Matrix2d>> weights_;
  double scale_ = 1.0;
};

using Fit = ArrowFit<State>;

std::optional<Fit> minimize(const Problem& problem, const State& start, int iterations, double tolerance) {
  return minimizeArrow(
      start, [&](const State& state) { return problem.linearize(state); },
      [&](const State& state, const ArrowStep& step) { return problem.move(state, step); }, iterations,
      tolerance);
}

/// Per view, the square root of its chi-square per degree of freedom.
std::vector<double> viewScales(const Problem& problem, const State& state) {
  double rows = 0;
  for (const View& view : problem.views()) rows += 2.0 * view.detection->corners.size();
  const double free_share = std::max(0.2, 1.0 - 12.0 / rows);
  std::vector<double> scales;
  for (std::size_t i = 0; i < problem.views().size(); ++i) {
    const View& view = problem.views()[i];
    const std::optional<ViewCost> cost = problem.viewCost(state, view, state.corrections[i]);
    const double degrees = 2.0 * view.detection->corners.size() * free_share;
    scales.push_back(cost ? std::sqrt(cost->whitened / degrees) : INFINITY);
  }
  return scales;
}

/// Minimizes with the scale of the corner noise set so that the typical view has a chi-square of one per
/// degree of freedom. From afar it starts with a scale that is too large: the robot is believed first, and
/// what it cannot explain tells the noise.
std::optional<Fit> minimizeWithScale(Problem& problem, const State& start, bool start_is_close) {
  constexpr double kLeastScale = 0.2;  // claimed covariances that much too large are believed no further
  State state = start;
  for (int round = start_is_close ? 1 : 0; round < 12; ++round) {
    if (round != 1 || !start_is_close) {
      const double scale = std::max(kLeastScale, problem.scale() * median(viewScales(problem, state)));
      if (!std::isfinite(scale)) return std::nullopt;
      const bool settled = std::abs(scale / problem.scale() - 1.0) < 0.01;
      problem.setScale(scale);
      if (settled && round > 0) break;
    }
    const std::optional<Fit> fit = minimize(problem, state, 2, 1e-4);
    if (!fit) return std::nullopt;
    state = fit->state;
  }
  return minimize(problem, state, 60, 1e-13);
}

std::vector<double> correctionNorms(const Problem& problem, const State& state) {
  std::vector<double> norms;
  for (const Vector6d& correction : state.corrections) norms.push_back(problem.whitened(correction).norm());
  return norms;
}

/// In a small set one wrong robot pose bends the solution until all stops share its error. Where a correction
/// is beyond chance, believes each stop the less the more correction it needs and solves again, until the
/// error is back where it belongs. The state is for finding outliers only.
///
/// Source: iteratively reweighted least squares with the weights of Geman & McClure, 1987.
State withoutSmear(Problem& problem, State state) {
  constexpr double kBeyondChance = 5.5;  // of 6 numbers of unit variance: 1 in 40000
  std::vector<double> norms = correctionNorms(problem, state);
  for (int round = 0; round < 10; ++round) {
    if (*std::max_element(norms.begin(), norms.end()) < kBeyondChance) break;
    const double scale = std::max(kBeyondChance, 1.5 * median(norms));
    std::vector<double> belief;
    for (const double norm : norms) belief.push_back(std::pow(1.0 / (1.0 + std::pow(norm / scale, 2)), 2));
    problem.setBelief(belief);
    const std::optional<Fit> fit = minimize(problem, state, 4, 1e-4);
    if (!fit) break;
    state = fit->state;
    norms = correctionNorms(problem, state);
  }
  problem.setBelief(std::vector<double>(norms.size(), 1.0));
  return state;
}

/// Views that stand out beyond the spread of the others. Never so many that the rest says nothing.
std::vector<bool> outliers(const Problem& problem, const State& state) {
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

struct Solved {
  Fit fit;
  std::vector<View> used;
  std::vector<View> left_out;
};

/// Fit, leave out what stands out, fit again.
std::optional<Solved> solveGated(Problem& problem, const std::vector<View>& views, const State& start,
                                 bool start_is_close) {
  Solved solved{Fit{start, ArrowSystem(12, 0), false, 0}, views, {}};
  State state = start;
  for (int round = 0; round < 6; ++round) {
    problem.setViews(solved.used);
    std::optional<Fit> fit = minimizeWithScale(problem, state, start_is_close || round > 0);
    if (!fit) return std::nullopt;
    solved.fit = *std::move(fit);
    const std::vector<bool> out = outliers(problem, withoutSmear(problem, solved.fit.state));
    if (countTrue(out) == 0 || solved.used.size() - countTrue(out) < 3) break;
    state = {solved.fit.state.lMc, solved.fit.state.rMo, {}};
    std::vector<View> kept;
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

/// Solves once more with the views that were left out, each in the one of its poses that is nearest.
void keepAll(const BoardSpec& board, Problem& problem, const std::vector<View>& views,
             const std::vector<CandidateView>& candidates, Solved& solved,
             std::vector<Eigen::Isometry3d>& seen_cMo, std::vector<bool>& seen) {
  State state{solved.fit.state.lMc, solved.fit.state.rMo, {}};
  std::vector<View> all;
  for (std::size_t i = 0; i < views.size(); ++i) {
    View view = views[i];
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

}  // namespace

HandEyeOutcome solveHandEyeReprojection(const BoardSpec& board, const CameraModel& camera,
                                        const std::vector<Observation>& observations,
                                        const std::string& camera_name, Stream stream,
                                        const ReprojectionOptions& options) {
  check(options);
  HandEyeSolution solution;
  solution.mount = options.mount;
  std::vector<View> views;
  for (const Observation& observation : observations) {
    if (!observation.robot) continue;
    for (const StreamObservation& seen : observation.views) {
      if (seen.camera != camera_name || seen.stream != stream) continue;
      const Pose<Base, EndEffector>& bMe = observation.robot->bMe;
      if (!bMe.isFinite()) {
        throw std::invalid_argument("the robot pose of observation " + std::to_string(observation.id) +
                                    " is not finite");
      }
      const bool fixed = options.mount == Mount::kFixed;
      views.push_back({&seen.detection, fixed ? bMe.isometry() : bMe.inverse().isometry(),
                       solution.views.size(), false});
      const std::string& file = seen.image_file.empty() ? observation.stage : seen.image_file;
      solution.views.push_back({observation.id, file, 0.0, true, ""});
    }
  }

  HandEyeOutcome outcome;
  Problem problem(board, camera, options);
  std::optional<Solved> solved;
  std::vector<Eigen::Isometry3d> seen_cMo(views.size());  // per view, the pose of its image alone
  std::vector<bool> seen(views.size(), false);

  if (options.start) {
    std::vector<Eigen::Matrix3d> rotations;
    State state{options.start->camera_pose, options.start->board_pose, {}};
    std::vector<View> started;
    for (View view : views) {
      std::optional<ViewCost> cost = problem.viewCost(state, view, Vector6d::Zero());
      for (int turn = 1; turn < problem.turns().count(*view.detection); ++turn) {
        View other = view;
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
        return outcome;
      }
      solved = solveGated(problem, started, state, true);
      if (solved && solved->used.size() < 0.8 * views.size()) solved.reset();
    }
  }

  std::vector<CandidateView> candidates;  // filled only where they are needed
  const auto findCandidates = [&] {
    for (const View& view : views) {
      candidates.push_back(
          candidateView(board, problem.turns(), camera, *view.detection, Pose<Base, EndEffector>(view.lMr)));
    }
  };
  if (!solved) {
    findCandidates();
    HandEyeStart start = startHandEye(board, candidates, options.closed_form);
    outcome.status = start.status;
    outcome.axis_spread = start.axis_spread;
    if (start.status != HandEyeStatus::kSolved) return outcome;

    std::vector<View> left_out;
    for (int round = 0; round < 2; ++round) {
      State state{start.bMc.isometry(), start.eMo.isometry(), {}};
      if (round > 0) state = {solved->fit.state.lMc, solved->fit.state.rMo, {}};
      std::vector<int> choice;
      for (const CandidateView& candidate : candidates) {
        choice.push_back(nearestCandidate(board, candidate, Pose<Base, Color>(state.lMc),
                                          Pose<EndEffector, Board>(state.rMo)));
      }
      if (round > 0 && choice == start.choice) break;  // the better estimate changes no mind
      start.choice = choice;
      std::vector<View> chosen;
      left_out.clear();
      for (std::size_t i = 0; i < views.size(); ++i) {
        View view = views[i];
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
        return outcome;
      }
    }
    solved->left_out.insert(solved->left_out.end(), left_out.begin(), left_out.end());
  }

  if (!solved->left_out.empty()) {
    if (candidates.empty()) findCandidates();
    std::vector<Stop> stops;
    for (std::size_t i = 0; i < views.size(); ++i) {
      stops.push_back({views[i].detection, views[i].lMr, candidates[i].candidates});
    }
    for (const View& view : solved->left_out) solution.views[view.report].used = false;
    explainLeftOut(board, options.mount, solved->fit.state.lMc, solved->fit.state.rMo,
                   std::max(options.robot_sigma_m, 1e-3), stops, solution.views);
    if (options.keep_outliers) keepAll(board, problem, views, candidates, *solved, seen_cMo, seen);
  }

  // The same board, turned as the first view has it, if that would otherwise have to change its ids.
  const State& state = solved->fit.state;
  const bool any_known = std::any_of(solved->used.begin(), solved->used.end(), [](const View& view) {
    return view.detection->orientation_known;
  });
  const int first_turn = any_known ? 0 : solved->used.front().turn;
  const Eigen::Isometry3d first_rotation = problem.turns().rotation(first_turn).isometry();
  solution.camera_pose = state.lMc;
  solution.board_pose = state.rMo * first_rotation;
  for (const View& view : solved->used) {
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
    const View& view = solved->used[i];
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
  for (const View& view : solved->left_out) {
    const std::optional<ViewCost> cost = problem.viewCost(state, view, Vector6d::Zero());
    if (cost) solution.views[view.report].rms_px = cost->rms_px;
  }
  if (options.keep_outliers) {
    for (const View& view : solved->used) solution.views[view.report].used = true;
  }
  solution.rms_px = std::sqrt(squares_px2 / corners);
  solution.robot_rms_m = std::sqrt(squares_m2 / solved->used.size());
  solution.robot_rms_rad = std::sqrt(squares_rad2 / solved->used.size());
  fillScatter(seen_rMo, solution);
  outcome.status = HandEyeStatus::kSolved;
  outcome.solution = std::move(solution);
  return outcome;
}

}  // namespace servocal::calib
