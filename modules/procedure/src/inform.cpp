// SPDX-License-Identifier: GPL-3.0-or-later
// Views by information: what is known so far -> the stops that tell most -> servo, settle, observe.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "goals.h"
#include "joint.h"
#include "run.h"
#include "servocal/calib/forecast.h"
#include "servocal/calib/uncertainty.h"
#include "servocal/plan/informative_views.h"

namespace servocal::procedure {
namespace {

constexpr const char* kStage = "inform";
constexpr double kLeastWorth = 0.1;  // of a stop: a twentieth off one standard deviation still too large
constexpr int kFirstViews = 4;       // of a stream, before views are planned for it
constexpr int kDraws = 4;            // of candidates, without one of that worth, before there is none.
constexpr double kFarRatio = 1.5;              // far limit of the distances over the far views' least one
constexpr double kPlanMarginOfHeight = 0.012;  // A little more than the drive keeps.

using calib::JointCamera;
using calib::JointSolution;

/// Everything known so far, with the data sheets as priors.
struct Estimate {
  JointSolution plain;  // The arm as it reports: stops can be forecast.
  // Its geometry in doubt, which makes all of it less certain: what counts.
  std::optional<JointSolution> judged;
  const JointSolution& counts() const { return judged ? *judged : plain; }
};

std::optional<Estimate> estimate(Run& run) {
  std::vector<Observation> observations;
  for (const Observation& observation : run.observations()) {
    if (observation.stage != kCheckStage) observations.push_back(observation);
  }
  std::vector<std::string> notes;
  calib::JointOptions options = jointOptions(observations, solveOptions(run), notes);
  for (calib::JointStream& stream : options.streams) {
    if (!stream.prior) stream.prior = calib::nominalPrior(run.find(stream.camera, stream.stream)->nominal());
  }
  const auto solved = [&]() -> std::optional<JointSolution> {
    calib::JointOutcome outcome = calib::solveJoint(run.cell().board, observations, options);
    if (!outcome.solution || !outcome.solution->covariance.allFinite()) return std::nullopt;
    return std::move(outcome.solution);
  };
  auto plain = solved();
  if (!plain) return std::nullopt;
  options.robot_terms = geometryTerms(observations, solveOptions(run), notes);
  return Estimate{*std::move(plain), options.robot_terms ? solved() : std::nullopt};
}

void believe(Run& run, const JointSolution& solution) {
  for (const JointCamera& camera : solution.cameras) {
    Eye& eye = *run.find(camera.camera, camera.stream);
    eye.observer().setModel(camera.model);
    HandEyeSolution hand_eye;
    hand_eye.mount = solution.mount;
    hand_eye.camera_pose = camera.pose;
    hand_eye.board_pose = solution.board_pose;
    hand_eye.camera_sigma = solution.sigma.segment<6>(camera.pose_at);
    hand_eye.board_sigma = solution.sigma.segment<6>(solution.board_at);
    hand_eye.rms_px = camera.rms_px;
    run.believe(eye, std::move(hand_eye));
  }
}

double workingRangeM(const CellConfig& cell) {
  return cell.coverage.distance_ratio * cell.coverage.near_distance_m;
}

std::vector<Known> known(const JointSolution& solution, const CellConfig& cell) {
  std::vector<Known> streams;
  for (const JointCamera& camera : solution.cameras) {
    const auto worstPx = [&](std::optional<double> distance_m) {
      return calib::projectionMap(solution, camera, calib::Anchor::kBase, distance_m).worst_px;
    };
    streams.push_back({camera.camera + " " + toString(camera.stream),
                       std::max(worstPx({}), worstPx(workingRangeM(cell))),
                       calib::workspaceMap(solution, camera, cell.limits.workspace).worst_m});
  }
  return streams;
}

/// How much more certain everything seems while the arm's geometry is not in doubt: at most 1.
double seemingShare(const std::vector<Known>& seeming, const std::vector<Known>& judged) {
  double share = 1.0;
  for (std::size_t i = 0; i < seeming.size() && i < judged.size(); ++i) {
    share = std::min(
        {share, seeming[i].projection_px / judged[i].projection_px, seeming[i].point_m / judged[i].point_m});
  }
  return share;
}

bool isMet(const Known& stream, const PlannerConfig& goals) {
  return stream.projection_px <= goals.projection_goal_px && stream.point_m <= goals.point_goal_m;
}

std::vector<plan::Viewer> viewers(Run& run, const JointSolution& solution, const std::vector<Known>& now,
                                  const std::vector<std::vector<Pose<Color, Board>>>& tried) {
  std::vector<plan::Viewer> out;
  for (std::size_t i = 0; i < solution.cameras.size(); ++i) {
    Eye& eye = *run.find(solution.cameras[i].camera, solution.cameras[i].stream);
    if (eye.tooLate()) continue;
    plan::Viewer viewer{i,
                        {eye.model(), *eye.bMc(), run.eMo(eye), run.mount()},
                        plan::Detectability(run.cell().board, eye.model()),
                        &eye.coverage,
                        tried[i],
                        eye.camera(),
                        !(eye.excludesOthers() && eye.stream() == Stream::kInfrared),
                        !isMet(now[i], run.cell().planner) || !eye.coverage.complete(),
                        kPlanMarginOfHeight * eye.model().height_px};
    viewer.detectability.learn(eye.trials);
    out.push_back(std::move(viewer));
  }
  return out;
}

std::string standingText(const std::vector<Known>& streams) {
  double projection_px = 0.0, point_m = 0.0;
  for (const Known& stream : streams) {
    projection_px = std::max(projection_px, stream.projection_px);
    point_m = std::max(point_m, stream.point_m);
  }
  char text[120];
  std::snprintf(text, sizeof text, "Uncertain by at most %.2f px and %.2f mm.", projection_px, 1e3 * point_m);
  return text;
}

/// Drives to one view; false if it brought no observation.
bool drive(Run& run, Eye& eye, const plan::InformativeView& view) {
  run.backInSight(eye);
  const bool sees = eye.canStart(run.guard().state().bMe, run.eMo(eye));
  // The servo needs to see the board, and a straight way.
  if ((!sees || !view.straight) && run.travelTo(view.bMe)) return false;
  return run.visit(kStage, eye, view.cdMo).observation.has_value();
}

double motionTimeS(Run& run) {
  const auto span = run.guard().motionSpan();
  return span ? toSeconds(span->second - span->first) : 0.0;
}

/// Views of coverage for one eye, from where it sees the board.
void coverAlone(Run& run, Eye& eye, int views) {
  Eye& color = *run.find(eye.camera(), Stream::kColor);
  if (!eye.canStart(run.guard().state().bMe, run.eMo(eye)) && handOver(run, color)) return;
  cover(run, eye, views);
}

/// A stream with too few views has no place in the estimate by which views are planned: its first ones are those of
/// coverage. An infrared stream that is switched to only for itself may have none.
void takeFirstViews(Run& run) {
  for (Eye& eye : run.eyes()) {
    const auto views = std::count_if(run.observations().begin(), run.observations().end(), [&](const Observation& stop) {
      return std::any_of(stop.views.begin(), stop.views.end(), [&](const StreamObservation& view) {
        return view.camera == eye.camera() && view.stream == eye.stream();
      });
    });
    if (views >= kFirstViews || eye.tooLate()) continue;
    (void)run.updateBelief(eye);
    if (eye.bMc()) coverAlone(run, eye, kFirstViews - static_cast<int>(views));
  }
}

/// What the floors of coverage lack, eye by eye.
void fillFloors(Run& run) {
  for (Eye& eye : run.eyes()) {
    if (eye.coverage.exhausted() || !eye.bMc() || eye.tooLate() || !eye.handEye()) continue;
    coverAlone(run, eye, run.cell().coverage.max_views);
  }
}

/// The next view; none if none brings a goal much nearer.
std::optional<plan::InformativeView> nextView(Run& run, const Estimate& estimated,
                                              const std::vector<plan::Viewer>& looking, int& draws) {
  // Stops are forecast for an arm as it reports; the goals move by what that makes seem better than it is.
  const CellConfig& cell = run.cell();
  const std::vector<Known> seeming = known(estimated.plain, cell);
  const double share = seemingShare(seeming, known(estimated.counts(), cell));
  PlannerConfig goals = cell.planner;
  goals.projection_goal_px *= share;
  goals.point_goal_m *= share;
  const calib::Forecast forecast(
      cell.board, estimated.plain,
      {cell.limits.workspace, workingRangeM(cell), goals.projection_goal_px, goals.point_goal_m});
  plan::InformativeOptions options;
  options.near_m = cell.coverage.near_distance_m;
  options.far_m = kFarRatio * workingRangeM(cell);
  options.least_worth = kLeastWorth;
  for (int i = 0; i < kDraws; ++i) {
    options.draw = draws++;
    auto view =
        plan::informativeView(forecast, looking, cell.board, run.guard(), run.guard().state().q, options);
    if (view) return view;
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> inform(Run& run) {
  const PlannerConfig& goals = run.cell().planner;
  int stops =
      static_cast<int>(std::count_if(run.observations().begin(), run.observations().end(),
                                     [](const auto& observation) { return observation.stage == kStage; }));
  takeFirstViews(run);
  std::vector<std::vector<Pose<Color, Board>>> tried;  // by stream of the estimate
  std::optional<std::string> ended;
  for (int draws = 0; !ended;) {
    const std::optional<Estimate> estimated = estimate(run);
    if (!estimated) {
      ended = "the views do not determine a joint estimate by which to plan more";
      break;
    }
    const std::vector<JointCamera>& streams = estimated->plain.cameras;
    believe(run, estimated->plain);
    tried.resize(streams.size());
    const std::vector<Known> now = known(estimated->counts(), run.cell());
    run.report(kStage, run.eyes().front(), stops, goals.max_views, standingText(now));
    if (goalsMissed(now, goals).empty()) break;
    if (stops >= goals.max_views) {
      ended = "the budget of " + std::to_string(goals.max_views) + " views ended";
    } else if (motionTimeS(run) >= goals.max_time_s) {
      ended = "the budget of " + std::to_string(static_cast<int>(goals.max_time_s)) + " s ended";
    }
    if (ended) break;

    const std::vector<plan::Viewer> looking = viewers(run, estimated->plain, now, tried);
    const auto view = nextView(run, *estimated, looking, draws);
    if (!view) {
      ended = "no view tells much more";
      break;
    }
    const std::size_t stream = looking[view->viewer].camera;
    Eye& eye = *run.find(streams[stream].camera, streams[stream].stream);
    tried[stream].push_back(view->cdMo);
    stops += drive(run, eye, *view);
    run.report(kStage, eye, stops, goals.max_views);
  }
  fillFloors(run);
  return ended;
}

}  // namespace servocal::procedure
