// SPDX-License-Identifier: GPL-3.0-or-later
#include "stream_solver.h"

#include <algorithm>
#include <cmath>

#include "servocal/core/error.h"

namespace servocal::procedure {
namespace {

/// Images in which nobody saw the board, so that the result accounts for every one of them.
void listUnseen(const std::vector<Observation>& observations, std::vector<ViewResidual>& views) {
  for (const Observation& observation : observations) {
    if (!observation.views.empty()) continue;
    views.push_back({observation.id, observation.stage, 0.0, false,
                     observation.robot ? "no board found; its robot pose is left out too" : "no board found",
                     ViewCause::kNoBoard});
  }
  std::stable_sort(views.begin(), views.end(), [](const ViewResidual& a, const ViewResidual& b) {
    return a.observation_id < b.observation_id;
  });
}

int usedViews(const std::vector<ViewResidual>& views) {
  return static_cast<int>(
      std::count_if(views.begin(), views.end(), [](const ViewResidual& view) { return view.used; }));
}

/// Views left out for another reason than that there is no board in them.
bool hasOutliers(const std::vector<ViewResidual>& views) {
  return std::any_of(views.begin(), views.end(), [](const ViewResidual& view) {
    return !view.used && view.cause != ViewCause::kNoBoard;
  });
}

}  // namespace

StreamSolver::StreamSolver(const BoardSpec& board, const std::vector<Observation>& observations,
                           const std::string& camera, Stream stream, const SolveOptions& options)
    : board_(board), observations_(observations), stream_(stream), options_(options) {
  result_.camera = camera;
}

std::string StreamSolver::name() const {
  return stream_ == Stream::kColor ? result_.camera : result_.camera + " " + toString(stream_);
}

std::optional<CameraResult> StreamSolver::solve(bool has_robot) {
  auto intrinsics = solveIntrinsics();
  if (!intrinsics) return std::nullopt;
  result_.intrinsics = *std::move(intrinsics);
  if (has_robot) solveHandEye();
  return std::move(result_);
}

std::optional<IntrinsicsResult> StreamSolver::solveIntrinsics() {
  const auto given = options_.given_intrinsics.find({result_.camera, stream_});
  if (given != options_.given_intrinsics.end()) {
    IntrinsicsResult believed;  // No standard deviations: nothing was estimated.
    believed.camera = given->second;
    return believed;
  }
  calib::IntrinsicsOptions options = options_.intrinsics;
  calib::IntrinsicsOutcome outcome =
      calib::solveIntrinsics(board_, observations_, result_.camera, stream_, options);
  if (!outcome.result) {
    missing_.push_back("intrinsics of " + name() + ": " + calib::toString(outcome.status));
    return std::nullopt;
  }
  if (hasOutliers(outcome.result->views)) {
    options.outlier_ratio = 0;
    result_.intrinsics_with_outliers =
        calib::solveIntrinsics(board_, observations_, result_.camera, stream_, options).result;
    if (!result_.intrinsics_with_outliers) {
      result_.notes.push_back("with the views that were left out, the intrinsics cannot be solved");
    }
  }
  listUnseen(observations_, outcome.result->views);
  return std::move(outcome.result);
}

void StreamSolver::solveHandEye() {
  calib::ReprojectionOptions options;
  options.mount = options_.mount;
  options.robot_sigma_m = options_.robot_sigma_m;
  options.robot_sigma_rad = options_.robot_sigma_rad;
  const auto solved = [&] {
    return calib::solveHandEyeReprojection(board_, model(), observations_, result_.camera, stream_, options);
  };
  calib::HandEyeOutcome outcome = solved();
  if (const auto contradiction = findContradiction(outcome)) {
    const std::string sentence = "hand-eye of " + name() + ": " + *contradiction;
    if (options_.refuse_contradictions) throw Error(ErrorKind::kBadData, sentence);
    missing_.push_back(sentence);
  } else if (!outcome.solution) {
    missing_.push_back("hand-eye of " + name() + ": " + calib::toString(outcome.status));
  }
  if (!outcome.solution) return;
  if (hasOutliers(outcome.solution->views)) {
    options.keep_outliers = true;
    auto with = solved().solution;
    if (with && usedViews(with->views) > usedViews(outcome.solution->views)) {
      result_.hand_eye_with_outliers = std::move(with);
    } else {
      result_.notes.push_back("with the views that were left out, the hand-eye cannot be solved");
    }
  }
  result_.hand_eye = *std::move(outcome.solution);
  listUnseen(observations_, result_.hand_eye->views);
  noteWhatTheRobotDecided();
}

/// A sentence if robot and images cannot both be right; a note if they nearly can.
std::optional<std::string> StreamSolver::findContradiction(const calib::HandEyeOutcome& outcome) {
  constexpr double kMostScaleError = 0.1, kScaleErrorWorthANote = 0.01, kSigmas = 5.0, kLeastShare = 0.8;
  // Rotations that seem to be about one axis may be misread ones: degrees read as radians and the like.
  bool doubtful = outcome.status != calib::HandEyeStatus::kTooFewViews;
  if (outcome.solution) {
    const auto& views = outcome.solution->views;
    doubtful = usedViews(views) < kLeastShare * static_cast<double>(views.size());
  } else if (!doubtful) {
    return std::nullopt;
  }
  if (doubtful) {
    const auto why = calib::explainContradiction(board_, model(), observations_, result_.camera, stream_,
                                                 options_.mount, options_.readings);
    if (why) return options_.poses_from + " and the images contradict each other; they agree if " + *why;
  }
  if (outcome.status == calib::HandEyeStatus::kInconsistent) {
    return options_.poses_from + " and the images contradict each other. Check that poses and images belong "
           "together, the direction and units of the poses, and the size of the board";
  }
  if (!outcome.solution) return std::nullopt;
  auto scale = calib::boardScale(board_, model(), observations_, result_.camera, stream_, options_.mount);
  if (!scale) return std::nullopt;
  // A focal length error stretches all depths alike.
  if (result_.intrinsics.sigma.size() > 0) {
    scale->sigma = std::hypot(scale->sigma, result_.intrinsics.sigma[0] / model().fx());
  }
  result_.board_scale = scale;
  const double off = std::abs(scale->scale - 1.0);
  if (off < std::max(kScaleErrorWorthANote, kSigmas * scale->sigma)) return std::nullopt;
  const std::string sizes = calib::sizeText(board_, scale->scale);
  if (off > kMostScaleError) {
    return options_.poses_from + " and the images contradict each other; they agree if " + sizes +
           " (or if the robot's lengths are off in that ratio)";
  }
  result_.notes.push_back(sizes + ": measure the board; its size scales the whole result");
  return std::nullopt;
}

void StreamSolver::noteWhatTheRobotDecided() {
  const HandEyeSolution& solution = *result_.hand_eye;
  const auto of = [](int part, int whole) { return std::to_string(part) + " of " + std::to_string(whole); };
  const int used = usedViews(solution.views);
  if (solution.symmetric_views > 0) {
    std::string note = "the board looks the same after a turn about its normal; the robot's motion decided how " +
                       std::to_string(solution.symmetric_views) + " views belong together, and turned the corner "
                       "numbers of " + of(solution.resolved_turns, solution.symmetric_views);
    if (solution.symmetric_views == used) {
      note += ". One turn common to all views stays undetermined: that of the board's own pose, not the camera's";
    }
    result_.notes.push_back(note);
  }
  if (solution.resolved_flips > 0) {
    result_.notes.push_back("pose flip resolved in " + of(solution.resolved_flips, used) +
                            " views: of the two poses that a plane has, the robot chose the one that fits the "
                            "image less well");
  }
}

}  // namespace servocal::procedure
