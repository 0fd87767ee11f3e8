// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_start.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <variant>

#include "corner_weight.h"
#include "hand_eye_start.h"
#include "median.h"
#include "servocal/calib/board_pose.h"
#include "servocal/calib/diagnose.h"
#include "servocal/calib/reprojection.h"

namespace servocal::calib {
namespace {

const StreamObservation* viewOf(const Observation& observation, const JointStream& stream) {
  for (const StreamObservation& seen : observation.views) {
    if (seen.camera == stream.camera && seen.stream == stream.stream) return &seen;
  }
  return nullptr;
}

/// The board with all its lengths multiplied.
BoardSpec scaled(BoardSpec board, double scale) {
  if (auto* checkers = std::get_if<Checkerboard>(&board.pattern)) checkers->square_size_m *= scale;
  if (auto* tags = std::get_if<TagGrid>(&board.pattern)) {
    tags->tag_size_m *= scale;
    tags->tag_gap_m *= scale;
  }
  if (auto* charuco = std::get_if<Charuco>(&board.pattern)) {
    charuco->square_size_m *= scale;
    charuco->marker_size_m *= scale;
  }
  if (auto* circles = std::get_if<CircleGrid>(&board.pattern)) {
    circles->spacing_m *= scale;
    circles->diameter_m *= scale;
  }
  return board;
}

struct CameraStart {
  CameraModel model;
  std::map<std::int64_t, ViewResidual> views;  // by observation
  int used = 0;
};

/// From images alone; where these leave the focal length open, from the prior or from what most cameras are.
std::optional<CameraStart> startCamera(const BoardSpec& board, const std::vector<Observation>& observations,
                                       const JointStream& stream) {
  IntrinsicsOptions options;
  options.lens = stream.lens;
  options.fixed = stream.fixed;
  options.prior = stream.prior;
  if (stream.prior) options.min_views = 1;
  IntrinsicsOutcome outcome = solveIntrinsics(board, observations, stream.camera, stream.stream, options);
  if (!outcome.result && !stream.prior) {
    const StreamObservation* seen = nullptr;
    for (const Observation& observation : observations) {
      if (!seen) seen = viewOf(observation, stream);
    }
    if (!seen) return std::nullopt;
    constexpr double kUsualFovRad = 1.1, kUsualSpread = 6.0;  // times the focal sigma of a data sheet
    IntrinsicsPrior prior = nominalPrior(
        CameraModel::fromFieldOfView(seen->width_px, seen->height_px, kUsualFovRad, stream.lens));
    prior.covariance.topLeftCorner<2, 2>() *= kUsualSpread * kUsualSpread;
    options.prior = prior;
    options.min_views = 1;
    outcome = solveIntrinsics(board, observations, stream.camera, stream.stream, options);
  }
  if (!outcome.result) return std::nullopt;
  CameraStart start{outcome.result->camera, {}, 0};
  for (const ViewResidual& view : outcome.result->views) {
    start.views[view.observation_id] = view;
    start.used += view.used ? 1 : 0;
  }
  return start;
}

struct Reference {
  HandEyeOutcome outcome;
  double scale = 1.0;
};

/// Hand-eye of one stream, on the board as large as the robot's motion says it is.
Reference referenceHandEye(const BoardSpec& board, const std::vector<Observation>& observations,
                           const JointStream& stream, const CameraStart& camera,
                           const JointOptions& options) {
  constexpr double kScaleWorthIt = 0.004;
  std::vector<Observation> sound;
  for (const Observation& observation : observations) {
    const auto found = camera.views.find(observation.id);
    if (found != camera.views.end() && found->second.used) sound.push_back(observation);
  }
  Reference out;
  if (options.board.scale) {
    const auto scale = boardScale(board, camera.model, sound, stream.camera, stream.stream, options.mount);
    if (scale && std::abs(scale->scale - 1.0) > std::max(kScaleWorthIt, 3.0 * scale->sigma))
      out.scale = scale->scale;
  }
  ReprojectionOptions reprojection;
  reprojection.mount = options.mount;
  reprojection.robot_sigma_m = options.robot_sigma_m;
  reprojection.robot_sigma_rad = options.robot_sigma_rad;
  reprojection.huber_sigma = options.huber_sigma;
  reprojection.closed_form = options.closed_form;
  out.outcome = solveHandEyeReprojection(scaled(board, out.scale), camera.model, sound, stream.camera,
                                         stream.stream, reprojection);
  return out;
}

/// The camera's pose that most of its views agree on, the board's pose being known: of the poses that single
/// views give, the one with the least median distance of the board in the others.
std::optional<Eigen::Isometry3d> cameraByBoard(const BoardSpec& board, const BoardTurns& turns,
                                               const CameraModel& model,
                                               const std::vector<const JointView*>& views,
                                               const std::vector<JointStop>& stops, Mount mount,
                                               const Eigen::Isometry3d& rMo) {
  constexpr std::size_t kMostTried = 40;  // more views add nothing to a start
  struct Seen {
    Eigen::Isometry3d lMo;
    std::vector<BoardPoseCandidate> candidates;
  };
  std::vector<Seen> seen;
  const std::size_t stride = 1 + views.size() / kMostTried;
  for (std::size_t i = 0; i < views.size(); i += stride) {
    const Eigen::Isometry3d& bMe = stops[views[i]->stop].bMe;
    const Eigen::Isometry3d lMr = mount == Mount::kFixed ? bMe : bMe.inverse();
    const CandidateView found =
        candidateView(board, turns, model, *views[i]->detection, Pose<Base, EndEffector>(lMr));
    if (!found.candidates.empty()) seen.push_back({lMr * rMo, found.candidates});
  }
  std::optional<Eigen::Isometry3d> best;
  double least_m = INFINITY;
  for (const Seen& one : seen) {
    for (const BoardPoseCandidate& candidate : one.candidates) {
      const Eigen::Isometry3d lMc = one.lMo * candidate.cMo.isometry().inverse(), cMl = lMc.inverse();
      std::vector<double> distances_m;
      for (const Seen& other : seen) {
        double nearest_m = INFINITY;
        for (const BoardPoseCandidate& there : other.candidates) {
          nearest_m =
              std::min(nearest_m, cornerDistance(board, Pose<Color, Board>(cMl * other.lMo), there.cMo));
        }
        distances_m.push_back(nearest_m);
      }
      const double middle_m = median(distances_m);
      if (middle_m < least_m) {
        least_m = middle_m;
        best = lMc;
      }
    }
  }
  return best;
}

/// Reads a view with the turn of the board that fits the state best.
void chooseTurn(const JointProblem& problem, const JointState& state, JointView& chosen) {
  const int count = problem.turns().count(*chosen.detection);
  if (count == 1) return;
  double least = INFINITY;
  JointView view = chosen;
  for (view.turn = 0; view.turn < count; ++view.turn) {
    const auto residual = problem.residual(state, view);
    const double cost = residual ? residual->residual.squaredNorm() + residual->robust_excess : INFINITY;
    if (cost >= least) continue;
    least = cost;
    chosen.turn = view.turn;
  }
}

/// All views with at least four corners, by stop, then camera.
std::vector<JointView> allViews(const JointProblem& problem) {
  std::vector<JointView> out;
  for (std::size_t i = 0; i < problem.stops().size(); ++i) {
    for (std::size_t k = 0; k < problem.options().streams.size(); ++k) {
      const StreamObservation* seen = viewOf(*problem.stops()[i].observation, problem.options().streams[k]);
      if (!seen || seen->detection.corners.size() < 4) continue;
      JointView view{i, k, &seen->detection, 0, {}};
      for (const Corner& corner : seen->detection.corners) {
        if (!problem.knows(corner.id)) {
          throw std::invalid_argument("the board has no corner " + std::to_string(corner.id));
        }
        view.weights.push_back(whitening(corner));
      }
      out.push_back(std::move(view));
    }
  }
  return out;
}

JointStatus statusOf(HandEyeStatus status) {
  switch (status) {
    case HandEyeStatus::kSolved: return JointStatus::kSolved;
    case HandEyeStatus::kTooFewViews: return JointStatus::kTooFewViews;
    case HandEyeStatus::kRotationAxesParallel: return JointStatus::kRotationAxesParallel;
    case HandEyeStatus::kNotConverged: return JointStatus::kNotConverged;
    case HandEyeStatus::kInconsistent: break;
  }
  return JointStatus::kInconsistent;
}

}  // namespace

std::vector<JointStop> jointStops(const std::vector<Observation>& observations, const JointOptions& options) {
  std::vector<JointStop> stops;
  for (const Observation& observation : observations) {
    if (!observation.robot) continue;
    const bool seen =
        std::any_of(options.streams.begin(), options.streams.end(),
                    [&](const JointStream& stream) { return viewOf(observation, stream) != nullptr; });
    if (!seen) continue;
    const std::string id = std::to_string(observation.id);
    if (!observation.robot->bMe.isFinite()) {
      throw std::invalid_argument("the robot pose of observation " + id + " is not finite");
    }
    JointStop stop{&observation, observation.robot->bMe.isometry(), {}};
    if (options.robot_terms) {
      stop.by_terms = options.robot_terms->jacobian(*observation.robot);
      const auto terms = static_cast<Eigen::Index>(options.robot_terms->names.size());
      if (stop.by_terms.rows() != 6 || stop.by_terms.cols() != terms || !stop.by_terms.allFinite()) {
        throw std::invalid_argument("the robot terms' Jacobian of observation " + id +
                                    " is not a finite 6 x " + std::to_string(terms) + " matrix");
      }
    }
    stops.push_back(stop);
  }
  return stops;
}

std::vector<JointView> jointViews(const JointProblem& problem, const JointState& state) {
  std::vector<JointView> views = allViews(problem);
  for (JointView& view : views) chooseTurn(problem, state, view);
  return views;
}

JointStart startJoint(const BoardSpec& board, const std::vector<Observation>& observations,
                      const JointProblem& problem) {
  const JointOptions& options = problem.options();
  JointStart out;
  std::vector<CameraStart> cameras;
  for (const JointStream& stream : options.streams) {
    std::optional<CameraStart> camera = startCamera(board, observations, stream);
    if (!camera) return out;
    cameras.push_back(*std::move(camera));
  }
  if (cameras.empty()) return out;

  for (JointView& view : allViews(problem)) {
    const Observation& observation = *problem.stops()[view.stop].observation;
    const std::string& file = viewOf(observation, options.streams[view.camera])->image_file;
    const ViewResidual& report = cameras[view.camera].views.at(observation.id);
    out.views.push_back(
        {std::move(view), file.empty() ? observation.stage : file, report.used, report.reason, report.cause});
  }

  // The stream that saw most; of equals the first. The next one if its views do not do.
  std::vector<std::size_t> order(cameras.size());
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return cameras[a].used > cameras[b].used; });
  std::optional<Reference> reference;
  std::size_t chosen = 0;
  for (const std::size_t k : order) {
    Reference tried = referenceHandEye(board, observations, options.streams[k], cameras[k], options);
    if (!reference) out.status = statusOf(tried.outcome.status);
    out.axis_spread = std::max(out.axis_spread, tried.outcome.axis_spread);
    reference = tried;
    chosen = k;
    if (tried.outcome.solution) break;
  }
  if (!reference->outcome.solution) return out;
  const HandEyeSolution& solution = *reference->outcome.solution;

  JointState& state = out.state;
  state.rMo = solution.board_pose;
  state.shape.scale_x = state.shape.scale_y = reference->scale;
  state.terms = Eigen::VectorXd::Zero(problem.layout().size - problem.layout().terms_at);
  state.corrections.assign(problem.stops().size(), Vector6d::Zero());
  std::map<std::int64_t, bool> robot_believed;
  for (const ViewResidual& view : solution.views) robot_believed[view.observation_id] = view.used;
  for (JointViewStart& start : out.views) {
    const auto found = robot_believed.find(problem.stops()[start.view.stop].observation->id);
    if (found != robot_believed.end() && !found->second) start.used = false;
  }
  const BoardSpec true_size = scaled(board, reference->scale);
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    std::vector<const JointView*> views;
    for (const JointViewStart& start : out.views) {
      if (start.view.camera == k && start.used) views.push_back(&start.view);
    }
    std::optional<Eigen::Isometry3d> lMc;
    if (k == chosen) {
      lMc = solution.camera_pose;
    } else {
      lMc = cameraByBoard(true_size, problem.turns(), cameras[k].model, views, problem.stops(), options.mount,
                          state.rMo);
    }
    if (!lMc) {
      out.status = JointStatus::kTooFewViews;
      return out;
    }
    state.cameras.push_back({cameras[k].model, *lMc});
  }
  for (JointViewStart& start : out.views) chooseTurn(problem, state, start.view);
  out.status = JointStatus::kSolved;
  return out;
}

}  // namespace servocal::calib
