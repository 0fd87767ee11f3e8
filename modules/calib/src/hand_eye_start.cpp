// SPDX-License-Identifier: GPL-3.0-or-later
#include "hand_eye_start.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "servocal/calib/board_pose.h"

namespace servocal::calib {
namespace {

/// A view agrees if its board corners lie, on average, within this fraction of the board's distance of
/// where they are predicted: several times what noise, a rough closed form and a focal length 5 % off
/// do, several times less than a flipped or turned board.
constexpr double kAgreementRatio = 0.05;
/// Share of views that must agree for a solution to be taken without looking further, and at all.
constexpr double kGoodShare = 0.85;
constexpr double kLeastShare = 0.5;

struct Nearest {
  int candidate = -1;
  double share_of_limit = 1.0;  // in [0, 1]
};

Nearest nearest(const BoardSpec& board, const CandidateView& view, const Pose<Base, Color>& bMc,
                const Pose<EndEffector, Board>& eMo, double scale) {
  const Pose<Color, Board> in_robot_lengths = bMc.inverse() * view.bMe * eMo;
  const Pose<Color, Board> predicted(in_robot_lengths.rotation(), in_robot_lengths.translation() / scale);
  Nearest best;
  if (!(scale > 0)) return best;
  for (std::size_t i = 0; i < view.candidates.size(); ++i) {
    const Pose<Color, Board>& cMo = view.candidates[i].cMo;
    const double limit_m = kAgreementRatio * cMo.translation().norm();
    const double share = cornerDistance(board, predicted, cMo) / limit_m;
    if (share < best.share_of_limit) best = {static_cast<int>(i), share};
  }
  return best;
}

struct Consensus {
  Pose<Base, Color> bMc;
  Pose<EndEffector, Board> eMo;
  double scale = 1.0;
  std::vector<int> choice;
  int agreeing = 0;
  double score = 0.0;  // sum over views of 1 - share^2
};

Consensus consensus(const BoardSpec& board, const std::vector<CandidateView>& views,
                    const HandEyeResult& solved) {
  Consensus out{*solved.bMc, *solved.eMo, solved.scale, std::vector<int>(views.size(), -1), 0, 0.0};
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Nearest found = nearest(board, views[i], out.bMc, out.eMo, out.scale);
    out.choice[i] = found.candidate;
    if (found.candidate >= 0) ++out.agreeing;
    out.score += 1.0 - found.share_of_limit * found.share_of_limit;
  }
  return out;
}

HandEyeResult solveChoice(const std::vector<CandidateView>& views, const std::vector<int>& choice,
                          const HandEyeOptions& options) {
  std::vector<HandEyeView> chosen;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (choice[i] >= 0) chosen.push_back({views[i].bMe, views[i].candidates[choice[i]].cMo});
  }
  return solveHandEye(chosen, options);
}

/// Solves on the chosen candidates and chooses anew until nothing changes.
Consensus settle(const BoardSpec& board, const std::vector<CandidateView>& views, Consensus current,
                 const HandEyeOptions& options) {
  for (int round = 0; round < 6; ++round) {
    const HandEyeResult solved = solveChoice(views, current.choice, options);
    if (solved.status != HandEyeStatus::kSolved) break;
    Consensus next = consensus(board, views, solved);
    if (next.score <= current.score) break;
    const bool same = next.choice == current.choice;
    current = std::move(next);
    if (same) break;
  }
  return current;
}

Consensus sampleConsensus(const BoardSpec& board, const std::vector<CandidateView>& views,
                          const HandEyeOptions& options, Consensus best) {
  const int count = static_cast<int>(views.size());
  // Samples that turn little give a closed form too rough to judge the others by.
  double largest_rad = 0;
  for (int i = 1; i < count; ++i) largest_rad = std::max(largest_rad, angleRad(views[0].bMe, views[i].bMe));
  const double least_rad = std::clamp(0.4 * largest_rad, options.min_rotation_rad, 0.3);
  constexpr double kAngleTolerance_rad = 0.1;

  std::mt19937 random(20161205);  // the same samples for the same input
  int solved_samples = 0;
  for (int draw = 0; draw < 6000 && solved_samples < 300; ++draw) {
    std::array<int, 3> view{}, candidate{};
    std::vector<HandEyeView> sample;
    for (int k = 0; k < 3; ++k) {
      view[k] = static_cast<int>(random() % count);
      const auto& candidates = views[view[k]].candidates;
      if (candidates.empty() || std::find(view.begin(), view.begin() + k, view[k]) != view.begin() + k) break;
      candidate[k] = static_cast<int>(random() % candidates.size());
      sample.push_back({views[view[k]].bMe, candidates[candidate[k]].cMo});
    }
    if (sample.size() < 3) continue;
    bool agree = true;
    int turning = 0;
    for (int k = 0; k < 3 && agree; ++k) {
      const HandEyeView &a = sample[k], &b = sample[(k + 1) % 3];
      const double robot_rad = angleRad(a.bMe, b.bMe);
      agree = std::abs(robot_rad - angleRad(a.cMo, b.cMo)) < kAngleTolerance_rad;
      if (robot_rad > least_rad) ++turning;
    }
    if (!agree || turning < 2) continue;
    HandEyeOptions sample_options = options;
    sample_options.min_axis_spread = std::max(0.02, options.min_axis_spread);
    const HandEyeResult solved = solveHandEye(sample, sample_options);
    if (solved.status != HandEyeStatus::kSolved) continue;
    ++solved_samples;
    Consensus trial = consensus(board, views, solved);
    if (trial.score <= best.score) continue;
    best = settle(board, views, std::move(trial), options);
    if (best.agreeing >= 0.98 * count) break;
  }
  return best;
}

}  // namespace

CandidateView candidateView(const BoardSpec& board, const BoardTurns& turns, const CameraModel& camera,
                            const BoardDetection& detection, const Pose<Base, EndEffector>& bMe) {
  CandidateView view{bMe, {}};
  const std::vector<BoardPose> poses = boardPoses(board, camera, detection);
  for (int turn = 0; turn < turns.count(detection); ++turn) {
    for (std::size_t i = 0; i < poses.size(); ++i) {
      view.candidates.push_back(
          {poses[i].cMo * turns.rotation(turn).inverse(), turn, i == 0, poses[i].rms_px});
    }
  }
  return view;
}

double axisSpread(const std::vector<Eigen::Matrix3d>& bRe, double min_rotation_rad) {
  std::vector<Eigen::Quaterniond> rotations;
  for (const Eigen::Matrix3d& rotation : bRe) rotations.emplace_back(rotation);
  const double least_sine = std::sin(0.5 * min_rotation_rad);
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    for (std::size_t j = i + 1; j < rotations.size(); ++j) {
      const Eigen::Vector3d axis = (rotations[j] * rotations[i].conjugate()).vec();
      const double sine = axis.norm();
      if (sine >= least_sine && sine > 0) scatter += axis * axis.transpose() / (sine * sine);
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(scatter, Eigen::EigenvaluesOnly);
  if (!(eigen.eigenvalues()[2] > 0)) return 0.0;
  return std::max(0.0, eigen.eigenvalues()[1] / eigen.eigenvalues()[2]);
}

double cornerDistance(const BoardSpec& board, const Pose<Color, Board>& first,
                      const Pose<Color, Board>& second) {
  const Eigen::Vector3d far = board.patternOutline()[2];
  const double x = far.x(), y = far.y();
  const Eigen::Vector3d translation = first.translation() - second.translation();
  const Eigen::Matrix3d rotation = first.rotation() - second.rotation();
  double sum = 0;
  for (const auto& [sign_x, sign_y] : {std::pair{1, 1}, {1, -1}, {-1, 1}, {-1, -1}}) {
    sum += (translation + rotation.col(0) * (sign_x * x) + rotation.col(1) * (sign_y * y)).norm();
  }
  return 0.25 * sum;
}

int nearestCandidate(const BoardSpec& board, const CandidateView& view, const Pose<Base, Color>& bMc,
                     const Pose<EndEffector, Board>& eMo) {
  return nearest(board, view, bMc, eMo, 1.0).candidate;
}

HandEyeStart startHandEye(const BoardSpec& board, const std::vector<CandidateView>& views,
                          const HandEyeOptions& options) {
  HandEyeStart start;
  std::vector<Eigen::Matrix3d> bRe;
  std::vector<int> first_choice(views.size(), -1);
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (views[i].candidates.empty()) continue;
    first_choice[i] = 0;
    bRe.push_back(views[i].bMe.rotation());
  }
  if (bRe.size() < 3) return start;
  start.axis_spread = axisSpread(bRe, options.min_rotation_rad);
  if (!(start.axis_spread >= options.min_axis_spread)) {
    start.status = HandEyeStatus::kRotationAxesParallel;
    return start;
  }
  Consensus best;
  best.choice.assign(views.size(), -1);
  const HandEyeResult plain = solveChoice(views, first_choice, options);
  if (plain.status == HandEyeStatus::kSolved) {
    best = settle(board, views, consensus(board, views, plain), options);
  }
  const auto with_pose = static_cast<double>(bRe.size());
  if (best.agreeing < kGoodShare * with_pose) best = sampleConsensus(board, views, options, std::move(best));
  // Three views agree by chance too easily where there are more.
  if (best.agreeing < std::min(4.0, with_pose) || best.agreeing < kLeastShare * with_pose) {
    start.status = HandEyeStatus::kInconsistent;
    return start;
  }
  // What is left must still turn about two axes.
  std::vector<Eigen::Matrix3d> agreeing;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (best.choice[i] >= 0) agreeing.push_back(views[i].bMe.rotation());
  }
  start.axis_spread = axisSpread(agreeing, options.min_rotation_rad);
  if (!(start.axis_spread >= options.min_axis_spread)) {
    start.status = HandEyeStatus::kRotationAxesParallel;
    return start;
  }
  start.status = HandEyeStatus::kSolved;
  start.bMc = best.bMc;
  start.eMo = best.eMo;
  start.scale = best.scale;
  start.choice = best.choice;
  return start;
}

}  // namespace servocal::calib
