// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/camera_pair.h"

#include <algorithm>
#include <cmath>

#include "arrow.h"
#include "corner_weight.h"
#include "median.h"
#include "servocal/calib/board_pose.h"

namespace servocal::calib {
namespace {

constexpr double kHuberSigma = 2.5;
/// Two relative poses agree if they move the board's points by less than this share of its distance.
constexpr double kAgreementRatio = 0.05;
/// A turn of the board is ruled out if at most this share of the votes is for it.
constexpr double kClearlyFewer = 0.9;

struct SeenCorner {
  Eigen::Vector3d point_o;
  Eigen::Vector2d pixel;
  Eigen::Matrix2d weight;
};

struct View {
  std::vector<SeenCorner> corners[2];
  BoardDetection detections[2];
  std::size_t report = 0;  // index into CameraPair::views
};

/// One way to read a view: which planar solutions, and how the board is turned in the second camera.
struct Reading {
  Eigen::Isometry3d c1Mo, c1Mc2;
  int turn = 0;
};

struct State {
  Eigen::Isometry3d c1Mc2;
  std::vector<Eigen::Isometry3d> c1Mo;
};

const StreamObservation* find(const Observation& observation, const PairCamera& camera) {
  for (const StreamObservation& view : observation.views) {
    if (view.camera == camera.name && view.stream == camera.stream) return &view;
  }
  return nullptr;
}

BoardDetection turned(const BoardSpec& board, BoardDetection detection, int turn) {
  for (Corner& corner : detection.corners) corner.id = board.turnedId(corner.id, turn);
  std::sort(detection.corners.begin(), detection.corners.end(),
            [](const Corner& a, const Corner& b) { return a.id < b.id; });
  return detection;
}

std::vector<SeenCorner> seenCorners(const BoardSpec& board, const BoardDetection& detection) {
  std::vector<SeenCorner> corners;
  for (const Corner& corner : detection.corners)
    corners.push_back({board.corner(corner.id), corner.pixel, whitening(corner)});
  return corners;
}

std::vector<Reading> readings(const BoardSpec& board, const PairCamera& first, const PairCamera& second,
                              const View& view) {
  const bool fixed = view.detections[0].orientation_known && view.detections[1].orientation_known;
  const int turns = fixed ? 1 : board.symmetry();
  std::vector<Reading> all;
  const std::vector<BoardPose> firsts = boardPoses(board, first.model, view.detections[0]);
  for (int turn = 0; turn < turns; ++turn) {
    for (const BoardPose& c2Mo : boardPoses(board, second.model, turned(board, view.detections[1], turn))) {
      for (const BoardPose& c1Mo : firsts)
        all.push_back({c1Mo.cMo.isometry(), c1Mo.cMo.isometry() * c2Mo.cMo.isometry().inverse(), turn});
    }
  }
  return all;
}

/// How far apart two readings of the pair put the board's points, as a share of the agreement limit.
double disagreement(const Eigen::Isometry3d& c1Mc2, const Reading& reading, const std::vector<Eigen::Vector3d>& outline) {
  const Eigen::Isometry3d moved_by = c1Mc2 * reading.c1Mc2.inverse();
  double sum = 0.0;
  for (const Eigen::Vector3d& point_o : outline) {
    const Eigen::Vector3d point = reading.c1Mo * point_o;
    sum += (moved_by * point - point).norm();
  }
  return sum / outline.size() / (kAgreementRatio * reading.c1Mo.translation().norm());
}

/// For every view the reading that agrees with `c1Mc2` best, -1 if none does; and how well all agree.
std::pair<std::vector<int>, double> vote(const Eigen::Isometry3d& c1Mc2, const std::vector<std::vector<Reading>>& views,
                                         const std::vector<Eigen::Vector3d>& outline) {
  std::vector<int> choice(views.size(), -1);
  double score = 0.0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    double best = 1.0;
    for (std::size_t k = 0; k < views[i].size(); ++k) {
      const double share = disagreement(c1Mc2, views[i][k], outline);
      if (share < best) best = share, choice[i] = static_cast<int>(k);
    }
    score += 1.0 - best * best;
  }
  return {choice, score};
}

class Problem {
 public:
  Problem(const PairCamera& first, const PairCamera& second) : cameras_{&first.model, &second.model} {}

  std::vector<View> views;
  double scale = 1.0;  // of the corners' claimed standard deviations

  std::optional<ArrowSystem> linearize(const State& state) const {
    ArrowSystem system(6, static_cast<int>(views.size()));
    const Eigen::Matrix3d c2Rc1 = state.c1Mc2.linear().transpose();
    ProjectionJacobian derivative;
    Eigen::MatrixXd jacobian;
    Eigen::VectorXd residual;
    double robust_excess = 0.0;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const Eigen::Index rows = 2 * static_cast<Eigen::Index>(views[i].corners[0].size() + views[i].corners[1].size());
      jacobian.setZero(rows, 12);
      residual.resize(rows);
      Eigen::Index row = 0;
      for (int k = 0; k < 2; ++k) {
        for (const SeenCorner& corner : views[i].corners[k]) {
          const Eigen::Vector3d point_1 = state.c1Mo[i] * corner.point_o;
          const Eigen::Vector3d arm = point_1 - state.c1Mc2.translation();
          const auto pixel = cameras_[k]->project(k == 0 ? point_1 : Eigen::Vector3d(c2Rc1 * arm), derivative);
          if (!pixel) return std::nullopt;
          Eigen::Matrix2d weight = corner.weight / scale;
          const Eigen::Vector2d error = *pixel - corner.pixel;
          const double length = (weight * error).norm();
          if (length > kHuberSigma) {
            robust_excess += kHuberSigma * (length - kHuberSigma);
            weight *= std::sqrt(kHuberSigma / length);
          }
          residual.segment<2>(row) = weight * error;
          const Eigen::Matrix<double, 2, 3> by_point =
              k == 0 ? Eigen::Matrix<double, 2, 3>(weight * derivative.point)
                     : Eigen::Matrix<double, 2, 3>(weight * derivative.point * c2Rc1);
          if (k == 1) {
            jacobian.block<2, 3>(row, 0) = -by_point;
            jacobian.block<2, 3>(row, 3) = by_point * skew(arm);
          }
          jacobian.block<2, 6>(row, 6) = by_point * pointByMotion(point_1);
          row += 2;
        }
      }
      system.add(static_cast<int>(i), jacobian, residual);
    }
    system.cost += robust_excess;
    return system;
  }

  static State move(const State& state, const ArrowStep& step) {
    State out = state;  // The second camera turns about its own origin, along the first one's axes.
    out.c1Mc2.linear() = rotationExp(step.shared.tail<3>()) * state.c1Mc2.linear();
    out.c1Mc2.translation() += step.shared.head<3>();
    for (std::size_t i = 0; i < out.c1Mo.size(); ++i) out.c1Mo[i] = moved(state.c1Mo[i], step.blocks[i]);
    return out;
  }

  /// Squared residuals of one view: px^2, and in units of the scaled standard deviations.
  std::pair<double, double> squares(const State& state, std::size_t i) const {
    double px2 = 0.0, whitened = 0.0;
    for (int k = 0; k < 2; ++k) {
      const Eigen::Isometry3d cMo = k == 0 ? state.c1Mo[i] : state.c1Mc2.inverse() * state.c1Mo[i];
      for (const SeenCorner& corner : views[i].corners[k]) {
        const auto pixel = cameras_[k]->project(cMo * corner.point_o);
        if (!pixel) return {INFINITY, INFINITY};
        px2 += (*pixel - corner.pixel).squaredNorm();
        whitened += (corner.weight * (*pixel - corner.pixel)).squaredNorm() / (scale * scale);
      }
    }
    return {px2, whitened};
  }

  /// Per view, the square root of its chi-square per degree of freedom.
  std::vector<double> viewScales(const State& state) const {
    std::vector<double> scales;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const double degrees = std::max(2.0, 2.0 * cornerCount(i) - 6.0 - 6.0 / views.size());
      scales.push_back(std::sqrt(squares(state, i).second / degrees));
    }
    return scales;
  }
  double cornerCount(std::size_t i) const {
    return static_cast<double>(views[i].corners[0].size() + views[i].corners[1].size());
  }

 private:
  const CameraModel* cameras_[2];
};

std::optional<ArrowFit<State>> minimize(Problem& problem, const State& start) {
  std::optional<ArrowFit<State>> fit;
  State state = start;
  for (int round = 0; round < 8; ++round) {
    fit = minimizeArrow(
        state, [&](const State& s) { return problem.linearize(s); }, Problem::move, 60, 1e-13);
    if (!fit) return std::nullopt;
    state = fit->state;
    constexpr double kLeastScale = 0.2;  // claimed covariances that much too large are believed no further
    const double scale = std::max(kLeastScale, problem.scale * median(problem.viewScales(state)));
    if (!std::isfinite(scale)) return std::nullopt;
    const bool settled = std::abs(scale / problem.scale - 1.0) < 0.01;
    problem.scale = scale;
    if (settled) break;
  }
  return fit;
}

}  // namespace

const char* toString(PairStatus status) {
  switch (status) {
    case PairStatus::kSolved: return "solved";
    case PairStatus::kNoCommonView: return "the two cameras never see the board at the same moment; add such views";
    case PairStatus::kInconsistent:
      return "the views of the two cameras contradict each other; check that their images belong together";
    case PairStatus::kAmbiguous:
      return "the board looks the same after a turn, and the views do not tell how it was turned between the two "
             "cameras; add views in which it is turned and tilted otherwise, or use a board with a mark";
    case PairStatus::kNotConverged: return "the solve did not converge; look for wrong detections, and add views";
  }
  return "?";
}

PairOutcome solveCameraPair(const BoardSpec& board, const PairCamera& first, const PairCamera& second,
                            const std::vector<Observation>& observations) {
  PairOutcome outcome;
  CameraPair solution;
  solution.first = first.name;
  solution.second = second.name;
  std::vector<View> views;
  std::vector<std::vector<Reading>> all;
  for (const Observation& observation : observations) {
    const StreamObservation* seen[2] = {find(observation, first), find(observation, second)};
    if (!seen[0] || !seen[1]) continue;
    View view{{}, {seen[0]->detection, seen[1]->detection}, solution.views.size()};
    const std::string& file = seen[0]->image_file.empty() ? observation.stage : seen[0]->image_file;
    solution.views.push_back({observation.id, file, 0.0, true, ""});
    all.push_back(readings(board, first, second, view));
    views.push_back(std::move(view));
  }
  if (views.empty()) return outcome;

  outcome.status = PairStatus::kInconsistent;
  const std::vector<Eigen::Vector3d> outline = board.patternOutline();
  std::vector<int> choice;
  double best = -1.0;
  State start;
  for (const std::vector<Reading>& candidates : all) {
    for (const Reading& candidate : candidates) {
      auto [votes, score] = vote(candidate.c1Mc2, all, outline);
      if (score <= best) continue;
      best = score;
      choice = std::move(votes);
      start.c1Mc2 = candidate.c1Mc2;
    }
  }
  if (choice.empty()) return outcome;
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (const Reading& rival : all[i]) {
      if (choice[i] < 0 || rival.turn == all[i][choice[i]].turn) continue;
      if (vote(rival.c1Mc2, all, outline).second < kClearlyFewer * best) continue;
      outcome.status = PairStatus::kAmbiguous;
      return outcome;
    }
  }
  Problem problem(first, second);
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (choice[i] < 0) {
      solution.views[i].used = false;
      solution.views[i].reason = all[i].empty() ? "no board pose: too few corners, or all on one line"
                                                : "contradicts the other views: images of different moments, or wrong detection";
      continue;
    }
    const Reading& reading = all[i][choice[i]];
    views[i].corners[0] = seenCorners(board, views[i].detections[0]);
    views[i].corners[1] = seenCorners(board, turned(board, views[i].detections[1], reading.turn));
    problem.views.push_back(views[i]);
    start.c1Mo.push_back(reading.c1Mo);
  }
  if (2 * problem.views.size() < views.size() || problem.views.empty()) return outcome;

  std::optional<ArrowFit<State>> fit = minimize(problem, start);
  for (int round = 0; fit && round < 3; ++round) {
    const std::vector<double> scales = problem.viewScales(fit->state);
    std::vector<View> kept;
    State state{fit->state.c1Mc2, {}};
    for (std::size_t i = 0; i < scales.size(); ++i) {
      // Well beyond what chance does to a chi-square of this many degrees.
      if (scales[i] > std::max(2.0, 1.0 + 4.0 / std::sqrt(2.0 * problem.cornerCount(i)))) {
        ViewResidual& report = solution.views[problem.views[i].report];
        report.used = false;
        report.rms_px = std::sqrt(problem.squares(fit->state, i).first / problem.cornerCount(i));
        report.reason = "stands out from the other views: images of different moments, blur or wrong detection";
        continue;
      }
      kept.push_back(problem.views[i]);
      state.c1Mo.push_back(fit->state.c1Mo[i]);
    }
    if (kept.size() == problem.views.size()) break;
    if (2 * kept.size() < views.size()) return outcome;
    problem.views = std::move(kept);
    fit = minimize(problem, state);
  }
  if (!fit) return outcome;
  if (!fit->converged) {
    outcome.status = PairStatus::kNotConverged;
    return outcome;
  }

  solution.first_by_second = fit->state.c1Mc2;
  solution.covariance = scaledInverse(reducedMatrix(fit->system));
  double px2 = 0.0, corners = 0.0;
  for (std::size_t i = 0; i < problem.views.size(); ++i) {
    const double view_px2 = problem.squares(fit->state, i).first;
    solution.views[problem.views[i].report].rms_px = std::sqrt(view_px2 / problem.cornerCount(i));
    px2 += view_px2;
    corners += problem.cornerCount(i);
  }
  solution.rms_px = std::sqrt(px2 / corners);
  outcome.status = PairStatus::kSolved;
  outcome.solution = std::move(solution);
  return outcome;
}

}  // namespace servocal::calib
