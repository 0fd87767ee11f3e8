// SPDX-License-Identifier: GPL-3.0-or-later
#include "link_watch.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace servocal::robot {
namespace {

// Between looks where something is near. Two round links that slip past each other in between overlap by far
// less than the clearance.
constexpr double kStepM = 0.02;
constexpr double kSlackM = 1e-9;

Objection objectionTo(const CollisionModel::Gap& gap) {
  const std::string names = "The " + std::string(gap.a) + " would ";
  if (gap.distance_m <= 0.0) return {GuardRule::kCollision, names + "touch the " + gap.b + "."};
  const std::string distance = std::to_string(static_cast<int>(std::floor(1000.0 * gap.distance_m)));
  return {GuardRule::kCollision, names + "come as near as " + distance + " mm to the " + gap.b + "."};
}

}  // namespace

std::optional<Objection> linkObjection(const std::vector<CollisionModel::Gap>& gaps, double clearance_m) {
  for (const CollisionModel::Gap& gap : gaps)
    if (gap.distance_m < clearance_m) return objectionTo(gap);
  return std::nullopt;
}

LinkWatch::LinkWatch(const CollisionModel& model, const Eigen::VectorXd& start, double clearance_m)
    : model_(model), clearance_m_(clearance_m), start_(model.gaps(start)), before_(start_), q_(start) {}

// Until the arm has moved so far, no pair can have come too near.
double LinkWatch::freeWay() const {
  double least = std::numeric_limits<double>::infinity();
  for (const CollisionModel::Gap& gap : before_) least = std::min(least, gap.distance_m - clearance_m_);
  return least;
}

std::optional<Objection> LinkWatch::moveTo(const Eigen::VectorXd& q, bool last) {
  moved_m_ += model_.travel(q - q_);
  q_ = q;
  if (moved_m_ < freeWay() || (!last && moved_m_ < kStepM)) return std::nullopt;
  moved_m_ = 0.0;
  const std::vector<CollisionModel::Gap> here = model_.gaps(q);
  for (std::size_t pair = 0; pair < here.size(); ++pair) {
    if (here[pair].distance_m >= clearance_m_) continue;
    if (start_[pair].distance_m < clearance_m_ && here[pair].distance_m >= before_[pair].distance_m - kSlackM)
      continue;
    return objectionTo(here[pair]);
  }
  before_ = here;
  return std::nullopt;
}

}  // namespace servocal::robot
