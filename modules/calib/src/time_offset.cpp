// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/time_offset.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "median.h"
#include "rigid_fit.h"

namespace servocal::calib {
namespace {

constexpr double kGridStep_s = 0.005;
constexpr double kOutlierRatio = 4.0;
constexpr double kGap_s = 0.1;  // of the robot's history, too long to interpolate

/// The board's centre by the robot, at any time within its history.
class RobotPath {
 public:
  RobotPath(const std::vector<RobotState>& states, const Pose<EndEffector, Board>& eMo)
      : states_(states), eMo_(eMo) {}

  /// Without gaps all the way.
  bool covers(double from_s, double to_s) const {
    auto state = std::upper_bound(states_.begin(), states_.end(), from_s, before);
    if (state == states_.begin()) return false;
    for (--state; toSeconds(state->stamp) < to_s; ++state) {
      if (state + 1 == states_.end() || toSeconds((state + 1)->stamp - state->stamp) > kGap_s) return false;
    }
    return true;
  }
  Eigen::Vector3d at(double time_s) const {
    auto after = std::upper_bound(states_.begin(), states_.end(), time_s, before);
    if (after == states_.end()) --after;
    if (after == states_.begin()) ++after;
    const RobotState& second = *after;
    const RobotState& first = *(after - 1);
    const double start_s = toSeconds(first.stamp), span_s = toSeconds(second.stamp) - start_s;
    const double share = std::clamp((time_s - start_s) / span_s, 0.0, 1.0);
    const Eigen::Quaterniond turn = first.bMe.quaternion().slerp(share, second.bMe.quaternion());
    return first.bMe.translation() + share * (second.bMe.translation() - first.bMe.translation()) +
           turn * eMo_.translation();
  }

 private:
  static bool before(double time_s, const RobotState& state) { return time_s < toSeconds(state.stamp); }

  const std::vector<RobotState>& states_;
  Pose<EndEffector, Board> eMo_;
};

struct Samples {
  std::vector<double> stamps_s;
  std::vector<Eigen::Vector3d> seen;  // in the camera
};

std::vector<double> squaredErrors(const Samples& samples, const RobotPath& path, double offset_s) {
  std::vector<Eigen::Vector3d> by_robot;
  for (const double stamp_s : samples.stamps_s) by_robot.push_back(path.at(stamp_s - offset_s));
  const Eigen::Isometry3d bMc = rigidFit(samples.seen, by_robot);
  std::vector<double> errors;
  for (std::size_t i = 0; i < by_robot.size(); ++i) {
    errors.push_back((bMc * samples.seen[i] - by_robot[i]).squaredNorm());
  }
  return errors;
}

double cost(const Samples& samples, const RobotPath& path, double offset_s) {
  double sum = 0.0;
  for (const double error : squaredErrors(samples, path, offset_s)) sum += error;
  return sum;
}

struct Minimum {
  double offset_s = 0.0, cost = 0.0;
  double curvature = 0.0;  // second derivative of the cost
  bool inside = false;
};

Minimum minimize(const Samples& samples, const RobotPath& path, double search_s) {
  const int steps = static_cast<int>(std::ceil(search_s / kGridStep_s));
  Minimum best;
  best.cost = INFINITY;
  for (int k = -steps; k <= steps; ++k) {
    const double at = cost(samples, path, k * kGridStep_s);
    if (at < best.cost) best = {k * kGridStep_s, at, 0.0, std::abs(k) < steps};
  }
  // Parabolas, ever finer: the cost is smooth but for the corners of linear interpolation.
  double step = kGridStep_s;
  for (int round = 0; round < 4; ++round, step *= 0.5) {
    const double before = cost(samples, path, best.offset_s - step),
                 after = cost(samples, path, best.offset_s + step);
    const double bend = before + after - 2.0 * best.cost;
    if (!(bend > 0.0)) break;
    best.curvature = bend / (step * step);
    const double shift = std::clamp(0.5 * step * (before - after) / bend, -step, step);
    const double moved = cost(samples, path, best.offset_s + shift);
    if (!(moved < best.cost)) continue;
    best.offset_s += shift;
    best.cost = moved;
  }
  return best;
}

}  // namespace

const char* toString(TimeOffsetStatus status) {
  switch (status) {
    case TimeOffsetStatus::kSolved: return "the time offset was solved";
    case TimeOffsetStatus::kTooFewSamples:
      return "too few images of the moving board within the robot's history";
    case TimeOffsetStatus::kNoMotion: return "the board did not move: stamps can only be compared in motion";
    case TimeOffsetStatus::kBeyondSearch:
      return "the stamps are farther apart than searched, or do not belong together";
    case TimeOffsetStatus::kUncertain:
      return "the motion does not determine the time offset: the speed must change, and the board be seen "
             "well";
  }
  return "";
}

TimeOffset estimateTimeOffset(const std::vector<TimedBoard>& samples, const std::vector<RobotState>& states,
                              const Pose<EndEffector, Board>& eMo, const TimeOffsetOptions& options) {
  for (std::size_t i = 0; i < states.size(); ++i) {
    if (!states[i].bMe.isFinite() || (i > 0 && !(states[i].stamp > states[i - 1].stamp))) {
      throw std::invalid_argument("robot states must be finite and rise in time");
    }
  }
  if (!eMo.isFinite()) throw std::invalid_argument("eMo is not finite");
  const RobotPath path(states, eMo);
  Samples used;
  for (const TimedBoard& sample : samples) {
    if (!sample.cMo.isFinite()) throw std::invalid_argument("a board pose is not finite");
    const double stamp_s = toSeconds(sample.stamp);
    if (!path.covers(stamp_s - options.search_s, stamp_s + options.search_s)) continue;
    used.stamps_s.push_back(stamp_s);
    used.seen.push_back(sample.cMo.translation());
  }
  TimeOffset result;
  result.samples = static_cast<int>(used.seen.size());
  if (result.samples < std::max(options.min_samples, 4)) return result;
  const Eigen::Vector3d mean = meanOf(used.seen);
  double motion = 0.0;
  for (const Eigen::Vector3d& point : used.seen) motion += (point - mean).squaredNorm() / result.samples;
  result.status = TimeOffsetStatus::kNoMotion;
  if (std::sqrt(motion) < options.min_motion_m) return result;

  Minimum minimum = minimize(used, path, options.search_s);
  for (int round = 0; round < 3; ++round) {
    const std::vector<double> errors = squaredErrors(used, path, minimum.offset_s);
    const double gate = kOutlierRatio * kOutlierRatio * std::max(median(errors), 1e-12);
    Samples kept;
    for (std::size_t i = 0; i < errors.size(); ++i) {
      if (errors[i] > gate) continue;
      kept.stamps_s.push_back(used.stamps_s[i]);
      kept.seen.push_back(used.seen[i]);
    }
    if (kept.seen.size() == used.seen.size() || static_cast<int>(kept.seen.size()) < options.min_samples)
      break;
    used = std::move(kept);
    minimum = minimize(used, path, options.search_s);
  }
  result.samples = static_cast<int>(used.seen.size());
  result.status = TimeOffsetStatus::kBeyondSearch;
  if (!minimum.inside) return result;
  result.status = TimeOffsetStatus::kUncertain;
  // Half the second derivative is the information times the variance of one coordinate.
  const double variance = minimum.cost / (3.0 * result.samples - 7.0);
  if (!(minimum.curvature > 0.0)) return result;
  const double sigma_s = std::sqrt(2.0 * variance / minimum.curvature);
  if (!(sigma_s <= options.max_sigma_s)) return result;
  result.status = TimeOffsetStatus::kSolved;
  result.offset_s = minimum.offset_s;
  result.sigma_s = sigma_s;
  result.rms_m = std::sqrt(minimum.cost / result.samples);
  return result;
}

}  // namespace servocal::calib
