// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/procedure/solve.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>

#include "servocal/calib/camera_pair.h"
#include "servocal/calib/reprojection.h"
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

/// Solves one camera's part of a set of observations.
class CameraSolver {
 public:
  CameraSolver(const BoardSpec& board, const std::vector<Observation>& observations, const std::string& camera,
               const SolveOptions& options)
      : board_(board), observations_(observations), options_(options) {
    result_.camera = camera;
  }

  /// Intrinsics, and with robot poses the hand-eye. Nothing without intrinsics; missing() says why.
  std::optional<CameraResult> solve(bool has_robot) {
    auto intrinsics = solveIntrinsics();
    if (!intrinsics) return std::nullopt;
    result_.intrinsics = *std::move(intrinsics);
    if (has_robot) solveHandEye();
    return std::move(result_);
  }
  const std::vector<std::string>& missing() const { return missing_; }

 private:
  std::optional<IntrinsicsResult> solveIntrinsics() {
    const auto given = options_.given_intrinsics.find(result_.camera);
    if (given != options_.given_intrinsics.end()) {
      IntrinsicsResult believed;  // No standard deviations: nothing was estimated.
      believed.camera = given->second;
      return believed;
    }
    calib::IntrinsicsOptions options = options_.intrinsics;
    calib::IntrinsicsOutcome outcome =
        calib::solveIntrinsics(board_, observations_, result_.camera, Stream::kColor, options);
    if (!outcome.result) {
      missing_.push_back("intrinsics of " + result_.camera + ": " + calib::toString(outcome.status));
      return std::nullopt;
    }
    if (hasOutliers(outcome.result->views)) {
      options.outlier_ratio = 0;
      result_.intrinsics_with_outliers =
          calib::solveIntrinsics(board_, observations_, result_.camera, Stream::kColor, options).result;
      if (!result_.intrinsics_with_outliers) {
        result_.notes.push_back("with the views that were left out, the intrinsics cannot be solved");
      }
    }
    listUnseen(observations_, outcome.result->views);
    return std::move(outcome.result);
  }

  void solveHandEye() {
    calib::ReprojectionOptions options;
    options.mount = options_.mount;
    options.robot_sigma_m = options_.robot_sigma_m;
    options.robot_sigma_rad = options_.robot_sigma_rad;
    const auto solved = [&] {
      return calib::solveHandEyeReprojection(board_, model(), observations_, result_.camera, Stream::kColor, options);
    };
    calib::HandEyeOutcome outcome = solved();
    if (const auto contradiction = findContradiction(outcome)) {
      const std::string sentence = "hand-eye of " + result_.camera + ": " + *contradiction;
      if (options_.refuse_contradictions) throw Error(ErrorKind::kBadData, sentence);
      missing_.push_back(sentence);
    } else if (!outcome.solution) {
      missing_.push_back("hand-eye of " + result_.camera + ": " + calib::toString(outcome.status));
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

  const CameraModel& model() const { return result_.intrinsics.camera; }

  /// A sentence if robot and images cannot both be right; a note if they nearly can.
  std::optional<std::string> findContradiction(const calib::HandEyeOutcome& outcome) {
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
      const auto why = calib::explainContradiction(board_, model(), observations_, result_.camera, Stream::kColor,
                                                   options_.mount, options_.readings);
      if (why) return options_.poses_from + " and the images contradict each other; they agree if " + *why;
    }
    if (outcome.status == calib::HandEyeStatus::kInconsistent) {
      return options_.poses_from + " and the images contradict each other. Check that poses and images belong "
             "together, the direction and units of the poses, and the size of the board";
    }
    if (!outcome.solution) return std::nullopt;
    auto scale = calib::boardScale(board_, model(), observations_, result_.camera, Stream::kColor, options_.mount);
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

  void noteWhatTheRobotDecided() {
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

  const BoardSpec& board_;
  const std::vector<Observation>& observations_;
  const SolveOptions& options_;
  CameraResult result_;
  std::vector<std::string> missing_;
};

}  // namespace

CalibrationResult solve(const BoardSpec& board, const std::vector<Observation>& observations,
                        const SolveOptions& options) {
  CalibrationResult result;
  result.board = board;
  result.observations = static_cast<int>(observations.size());
  std::set<std::string> cameras;
  for (const Observation& observation : observations) {
    for (const StreamObservation& view : observation.views) cameras.insert(view.camera);
  }
  const bool has_robot = std::any_of(observations.begin(), observations.end(),
                                     [](const Observation& observation) { return observation.robot.has_value(); });
  if (cameras.empty()) {
    result.missing.push_back("the board was found in none of " + std::to_string(observations.size()) +
                             " images; check the board's description: it reads " + board.describe());
  }
  for (const std::string& camera : cameras) {
    CameraSolver solver(board, observations, camera, options);
    auto solved = solver.solve(has_robot);
    result.missing.insert(result.missing.end(), solver.missing().begin(), solver.missing().end());
    if (!solved) continue;
    if (!has_robot && cameras.size() == 1 && options.given_intrinsics.count(camera) > 0) {
      result.missing.push_back(camera + ": intrinsics are given and there are no robot poses; nothing to solve");
    }
    result.cameras.push_back(*std::move(solved));
  }
  for (std::size_t i = 1; i < result.cameras.size(); ++i) {
    const CameraResult &first = result.cameras.front(), &second = result.cameras[i];
    calib::PairOutcome pair =
        calib::solveCameraPair(board, {first.camera, Stream::kColor, first.intrinsics.camera},
                               {second.camera, Stream::kColor, second.intrinsics.camera}, observations);
    if (pair.solution) {
      result.camera_pairs.push_back(*std::move(pair.solution));
    } else if (!has_robot || pair.status != calib::PairStatus::kNoCommonView) {
      result.missing.push_back("pose of " + second.camera + " in " + first.camera + ": " + calib::toString(pair.status));
    }
  }
  result.goal_met = result.missing.empty();
  return result;
}

}  // namespace servocal::procedure
