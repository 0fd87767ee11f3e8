// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <iterator>
#include <map>
#include <set>

#include "joint_arm.h"
#include "servocal/calib/blame.h"
#include "servocal/calib/joint.h"
#include "servocal/calib/model_selection.h"
#include "servocal/calib/uncertainty.h"
#include "servocal/core/error.h"

namespace servocal::procedure {
namespace {

constexpr int kBlocks = 5, kLeastStopsToChoose = 20;  // Cross-validation.
constexpr int kLeastViews = 3;                        // Of a stream, to be solved at all.

using StreamKey = std::pair<std::string, Stream>;

std::string nameOf(const StreamKey& stream) { return stream.first + " " + toString(stream.second); }

bool mayHaveThirdRadial(const calib::JointStream& stream) {
  return stream.lens == LensModel::kPlumbBob && !stream.prior &&
         std::find(stream.fixed.begin(), stream.fixed.end(), "k3") == stream.fixed.end();
}

void holdThirdRadial(calib::JointOptions& joint) {
  for (calib::JointStream& stream : joint.streams) {
    if (mayHaveThirdRadial(stream)) stream.fixed.emplace_back("k3");
  }
}

struct Chosen {
  calib::JointOptions options;
  std::string sentence;
  std::optional<JointHeldOut> cross_validated;
};

Chosen choose(const BoardSpec& board, const std::vector<Observation>& observations,
              const SolveOptions& options, std::vector<std::string>& notes) {
  const calib::JointOptions asked = jointOptions(observations, options, notes);
  const auto stops = std::count_if(
      observations.begin(), observations.end(),
      [](const Observation& observation) { return observation.robot && !observation.views.empty(); });
  const std::string lean = "The lens as asked, a flat board, the arm as it reports";
  if (stops < kLeastStopsToChoose) {
    return {asked,
            lean + ": fewer than " + std::to_string(kLeastStopsToChoose) + " stops tell nothing more.",
            {}};
  }
  calib::JointOptions base = asked;
  std::vector<calib::ModelTerm> terms;
  if (std::any_of(asked.streams.begin(), asked.streams.end(), mayHaveThirdRadial)) {
    holdThirdRadial(base);
    terms.push_back({"third radial distortion (k3)",
                     [streams = asked.streams](calib::JointOptions& richer) { richer.streams = streams; }});
  }
  terms.push_back({"bow of the board", [](calib::JointOptions& richer) { richer.board.bow = true; }});
  if (auto arm = geometryTerms(observations, options, notes)) {
    terms.push_back({"errors of the arm's geometry",
                     [arm = *std::move(arm)](calib::JointOptions& richer) { richer.robot_terms = arm; }});
  }
  auto selection = calib::selectModel(board, observations, base, terms, kBlocks);
  if (!selection)
    return {asked, lean + ": the views held out in turn leave too few to determine it, so that nothing was compared.", {}};
  const calib::ModelScore& score = selection->score;
  return {std::move(selection->options), std::move(selection->sentence),
          JointHeldOut{score.views, score.rms_px, score.rms_m, score.z}};
}

/// Frame the cameras stand in to the frame that holds the board.
Eigen::Isometry3d holderPose(Mount mount, const RobotState& robot) {
  return mount == Mount::kFixed ? robot.bMe.isometry() : robot.bMe.inverse().isometry();
}

/// Where the board's origin was in the frame the cameras stand in, at the stops that a camera used.
std::vector<Eigen::Vector3d> boardPlaces(const std::vector<Observation>& observations,
                                         const calib::JointSolution& solution,
                                         const calib::JointCamera& camera) {
  std::set<std::int64_t> used;
  for (const ViewResidual& view : camera.views) {
    if (view.used) used.insert(view.observation_id);
  }
  std::vector<Eigen::Vector3d> places;
  for (const Observation& observation : observations) {
    if (!observation.robot || used.count(observation.id) == 0) continue;
    places.push_back(holderPose(solution.mount, *observation.robot) * solution.board_pose.translation());
  }
  return places;
}

double medianRange(const std::vector<Eigen::Vector3d>& places, const calib::JointCamera& camera) {
  std::vector<double> ranges;
  const Eigen::Isometry3d cMl = camera.pose.inverse();
  for (const Eigen::Vector3d& place : places) ranges.push_back((cMl * place).norm());
  if (ranges.empty()) return NAN;
  const auto middle = ranges.begin() + static_cast<std::ptrdiff_t>(ranges.size() / 2);
  std::nth_element(ranges.begin(), middle, ranges.end());
  return *middle;
}

Box boxAround(const std::vector<Eigen::Vector3d>& places) {
  Box box;
  if (places.empty()) return box;
  box.min_m = box.max_m = places.front();
  for (const Eigen::Vector3d& place : places) {
    box.min_m = box.min_m.cwiseMin(place);
    box.max_m = box.max_m.cwiseMax(place);
  }
  return box;
}

/// What is declared, or else what the board visited. The declared one is in the base, not on the flange.
Box workspaceFor(const calib::JointSolution& solution, const SolveOptions& options,
                 const std::vector<Eigen::Vector3d>& places) {
  return options.workspace && solution.mount == Mount::kFixed ? *options.workspace : boxAround(places);
}

JointCameraResult reportOf(const std::vector<Observation>& observations, const calib::JointSolution& solution,
                           const calib::JointCamera& camera, const SolveOptions& options) {
  JointCameraResult out;
  out.camera = camera.camera;
  out.stream = camera.stream;
  out.model = camera.model;
  out.sigma = Eigen::VectorXd::Zero(camera.model.parameters.size());
  if (options.given_intrinsics.count({camera.camera, camera.stream}) == 0) {
    for (std::size_t p = 0; p < camera.free.size(); ++p) {
      out.sigma[camera.free[p]] = solution.sigma[camera.intrinsics_at + static_cast<Eigen::Index>(p)];
    }
  }
  out.pose = camera.pose;
  out.pose_covariance = solution.covariance.block<6, 6>(camera.pose_at, camera.pose_at);
  out.rms_px = camera.rms_px;
  out.corner_scale = camera.corner_scale;
  const std::vector<Eigen::Vector3d> places = boardPlaces(observations, solution, camera);
  out.views = static_cast<int>(places.size());
  out.range_m = medianRange(places, camera);
  out.at_infinity = calib::projectionMap(solution, camera, calib::Anchor::kBase);
  out.at_range = calib::projectionMap(solution, camera, calib::Anchor::kBase, out.range_m);
  out.workspace = calib::workspaceMap(solution, camera, workspaceFor(solution, options, places));
  return out;
}

std::vector<JointPair> reportPairs(const std::vector<Observation>& observations, const calib::JointSolution& solution,
                                   const SolveOptions& options) {
  std::vector<JointPair> pairs;
  for (auto first = solution.cameras.begin(); first != solution.cameras.end(); ++first) {
    for (auto second = std::next(first); second != solution.cameras.end(); ++second) {
      const bool both_color = first->stream == Stream::kColor && second->stream == Stream::kColor;
      if (first->camera != second->camera && !both_color) continue;
      std::vector<Eigen::Vector3d> places = boardPlaces(observations, solution, *first);
      for (const Eigen::Vector3d& place : boardPlaces(observations, solution, *second)) places.push_back(place);
      const WorkspaceMap apart =
          calib::disagreementMap(solution, *first, *second, workspaceFor(solution, options, places));
      const CameraPair pair = calib::cameraPairOf(solution, *first, *second);
      pairs.push_back({first->camera, first->stream, second->camera, second->stream, pair.first_by_second,
                       pair.covariance, apart.worst_m, apart.rms_m, apart.seen});
    }
  }
  return pairs;
}

void reportCell(const calib::JointSolution& solution, JointResult& out) {
  out.mount = solution.mount;
  out.board_pose = solution.board_pose;
  out.board_sigma = solution.sigma.segment<6>(solution.board_at);
  out.board_scale_x = solution.board.scale_x;
  out.board_scale_y = solution.board.scale_y;
  out.board_bow_x_m = solution.board.bow_x_m;
  out.board_bow_y_m = solution.board.bow_y_m;
  out.robot_sigma_m = solution.robot.sigma_m;
  out.robot_sigma_rad = solution.robot.sigma_rad;
  out.declared_sigma_m = solution.robot.declared_m;
  out.declared_sigma_rad = solution.robot.declared_rad;
  for (Eigen::Index i = 0; i < solution.robot_terms.size(); ++i) {
    out.robot_terms.emplace_back(solution.robot_model->names[static_cast<std::size_t>(i)],
                                 solution.robot_terms[i]);
  }
  for (const calib::OpenDirection& direction : solution.open) out.open.push_back(direction.sentence);
  out.notes.insert(out.notes.end(), solution.notes.begin(), solution.notes.end());
}

std::string sentenceOf(const calib::JointOutcome& outcome) {
  std::string text = calib::toString(outcome.status);
  for (const calib::OpenDirection& direction : outcome.open) text += " " + direction.sentence;
  return text;
}

bool isUsed(const calib::JointSolution& solution, std::int64_t observation_id, const StreamObservation& view) {
  for (const calib::JointCamera& camera : solution.cameras) {
    if (camera.camera != view.camera || camera.stream != view.stream) continue;
    return std::any_of(camera.views.begin(), camera.views.end(), [&](const ViewResidual& residual) {
      return residual.used && residual.observation_id == observation_id;
    });
  }
  return false;
}

/// What views do not support is not corrected, but an arm has its declared accuracy all the same: smooth errors, which
/// more stops do not average out. They go into the covariance as parameters that are known to be zero only as well as
/// that ("consider" parameters; Tapley, Schutz, Born, "Statistical Orbit Determination", 2004).
/// How large they and the noise of the stops are is found with them free: noise found without has their errors in it.
calib::JointSolution withGeometryInDoubt(const BoardSpec& board, const std::vector<Observation>& observations,
                                         const SolveOptions& options, calib::JointOptions joint,
                                         calib::JointSolution solution, std::vector<std::string>& notes) {
  if (solution.robot_terms.size() > 0 || !solution.covariance.allFinite()) return solution;
  calib::JointSolution doubted = solution;
  doubted.robot_model = geometryTerms(observations, options, notes);
  if (!doubted.robot_model) return solution;
  joint.robot_terms = doubted.robot_model;
  if (const auto freed = calib::solveJoint(board, observations, joint).solution) {
    doubted.robot = freed->robot;
    doubted.robot_model = freed->robot_model;
  }
  doubted.robot_terms = Eigen::VectorXd::Zero(doubted.robot_model->prior_sigma.size());
  const Eigen::Index shared = solution.covariance.rows();
  std::vector<Observation> used;  // Views that were left out tell nothing.
  for (const Observation& observation : observations) {
    Observation kept = observation;
    kept.views.erase(std::remove_if(kept.views.begin(), kept.views.end(), [&](const StreamObservation& view) {
      return !isUsed(solution, observation.id, view);
    }), kept.views.end());
    if (!kept.views.empty()) used.push_back(std::move(kept));
  }
  solution.covariance = calib::jointCovarianceAt(board, used, doubted).topLeftCorner(shared, shared);
  for (Eigen::Index i = 0; i < shared; ++i) {
    if (std::isfinite(solution.sigma[i])) solution.sigma[i] = std::sqrt(solution.covariance(i, i));
  }
  return solution;
}

JointAnswer tryJointly(const BoardSpec& board, const std::vector<Observation>& observations,
                       const std::vector<Observation>& kept, const SolveOptions& options) {
  JointResult out;
  const Chosen chosen = choose(board, observations, options, out.notes);
  if (chosen.options.streams.empty())
    return {std::nullopt, calib::toString(calib::JointStatus::kTooFewViews), {}};
  calib::JointOutcome outcome = calib::solveJoint(board, observations, chosen.options);
  if (!outcome.solution) return {std::nullopt, sentenceOf(outcome), {}};
  const calib::JointSolution solution =
      withGeometryInDoubt(board, observations, options, chosen.options, *std::move(outcome.solution), out.notes);
  out.model = chosen.sentence;
  for (const calib::JointCamera& camera : solution.cameras) {
    out.cameras.push_back(reportOf(observations, solution, camera, options));
  }
  out.pairs = reportPairs(observations, solution, options);
  const auto halves = calib::compareHalves(board, observations, chosen.options, solution);
  for (std::size_t i = 0; i < halves.size(); ++i) out.cameras[i].halves = halves[i];
  reportCell(solution, out);
  for (const calib::Fault& fault : calib::findFaults(board, observations, solution).faults) {
    out.faults.push_back(fault.sentence);
  }
  const calib::HeldOut held_out = calib::predictHeldOut(board, kept, solution);
  out.notes.insert(out.notes.end(), held_out.notes.begin(), held_out.notes.end());
  if (!held_out.views.empty()) {
    out.held_out =
        JointHeldOut{static_cast<int>(held_out.views.size()), held_out.rms_px, held_out.rms_m, held_out.z};
  } else if (chosen.cross_validated) {
    out.held_out = chosen.cross_validated;
    out.notes.emplace_back(
        "no view was held out: the error in views not seen is that of a cross-validation in " +
        std::to_string(kBlocks) + " blocks");
  }
  std::map<std::string, calib::BoardPlaces> infrared_boards;
  for (const calib::JointCamera& camera : solution.cameras) {
    if (camera.stream != Stream::kInfrared || options.depth_sensors.count(camera.camera) == 0) continue;
    infrared_boards.emplace(camera.camera, calib::boardPlaces(board, observations, solution, camera));
  }
  return {std::move(out), "", std::move(infrared_boards)};
}

}  // namespace

calib::JointOptions jointOptions(const std::vector<Observation>& observations, const SolveOptions& options,
                                 std::vector<std::string>& notes) {
  calib::JointOptions joint;
  joint.mount = options.mount;
  joint.robot_sigma_m = options.robot_sigma_m;
  joint.robot_sigma_rad = options.robot_sigma_rad;
  joint.board.bow = false;
  std::map<StreamKey, int> views;
  for (const Observation& observation : observations) {
    if (!observation.robot) continue;
    for (const StreamObservation& view : observation.views) ++views[{view.camera, view.stream}];
  }
  for (const auto& [key, count] : views) {
    if (count < kLeastViews) {
      notes.push_back(nameOf(key) + " is not in the joint estimate: it saw the board " +
                      std::to_string(count) + " times, three are needed");
      continue;
    }
    calib::JointStream stream;
    stream.camera = key.first;
    stream.stream = key.second;
    stream.lens = options.intrinsics.lens;
    stream.fixed = options.intrinsics.fixed;
    const auto given = options.given_intrinsics.find(key);
    if (given != options.given_intrinsics.end()) {
      constexpr double kHeld = 1e-4;  // of what a data sheet leaves open: held, but for rounding
      stream.lens = given->second.lens;
      stream.fixed.clear();
      stream.prior = calib::nominalPrior(given->second);
      stream.prior->covariance *= kHeld * kHeld;
    }
    joint.streams.push_back(stream);
  }
  return joint;
}

std::optional<calib::RobotTerms> geometryTerms(const std::vector<Observation>& observations, const SolveOptions& options,
                                               std::vector<std::string>& notes) {
  const bool has_angles = std::all_of(
      observations.begin(), observations.end(),
      [](const Observation& observation) { return !observation.robot || observation.robot->q.size() > 0; });
  if (!options.arm || !has_angles) return std::nullopt;
  try {
    return armTerms(*options.arm, observations);
  } catch (const Error& error) {
    notes.push_back(std::string("errors of the arm's geometry are not considered: ") + error.what());
    return std::nullopt;
  }
}

JointAnswer solveJointly(const BoardSpec& board, const std::vector<Observation>& observations,
                         const std::vector<Observation>& kept, const SolveOptions& options) {
  const bool has_robot =
      std::any_of(observations.begin(), observations.end(),
                  [](const Observation& observation) { return observation.robot.has_value(); });
  if (!has_robot) return {};
  try {
    return tryJointly(board, observations, kept, options);
  } catch (const std::exception& error) {
    return {std::nullopt, error.what(), {}};
  }
}

}  // namespace servocal::procedure
