// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/servo/follow_path.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "approach.h"
#include "motion_loop.h"

namespace servocal::servo {
namespace {

using Path = std::vector<Eigen::VectorXd>;

constexpr double kGain = 4.0;              // 1/s. Not more: the guard looks 0.15 s ahead and then brakes.
constexpr double kBrakingShare = 0.8;      // Of the acceleration limits; the rest is for corrections.
constexpr double kStraightCosine = 0.985;  // Corners up to 10 degrees are none.
constexpr double kCornerRad = 0.01;        // A corner is passed from here on,
constexpr double kThereRad = 0.001;        // the end is reached.
constexpr double kProgressRad = 0.002;
constexpr double kLookRad = 0.02;  // Between two questions to the guard before the motion.

double largest(const Eigen::VectorXd& v) { return v.cwiseAbs().maxCoeff(); }

void requireUsable(const robot::Guard& guard, const Path& path, const FollowOptions& options) {
  if (path.empty()) throw std::invalid_argument("followPath: the path has no points");
  for (const Eigen::VectorXd& q : path)
    if (q.size() != guard.kinematics().joints() || !q.allFinite())
      throw std::invalid_argument("followPath: every point needs " +
                                  std::to_string(guard.kinematics().joints()) + " finite joint angles");
  if (!(options.speed_share > 0.0 && options.speed_share <= 1.0))
    throw std::invalid_argument("followPath: speed_share must be in (0, 1]");
  if (options.max_joint_speed_radps && !(*options.max_joint_speed_radps > 0.0))
    throw std::invalid_argument("followPath: max_joint_speed_radps must be positive");
}

// From where the arm stands; points that repeat are none.
Path withoutRepeats(const Eigen::VectorXd& here, const Path& path) {
  Path clean{here};
  for (std::size_t i = 1; i < path.size(); ++i)
    if (largest(path[i] - clean.back()) > kThereRad) clean.push_back(path[i]);
  if (clean.size() == 1) clean.push_back(path.back());
  clean.back() = path.back();
  return clean;
}

std::optional<WayObjection> objectionAlong(const robot::Guard& guard, const Path& path) {
  if (auto reason = guard.objection(path.back())) return WayObjection{true, *reason};
  bool was_free = false;  // An arm that stands where it may not be may leave.
  for (std::size_t i = 1; i < path.size(); ++i) {
    const Eigen::VectorXd way = path[i] - path[i - 1];
    const int steps = std::max(1, static_cast<int>(std::ceil(largest(way) / kLookRad)));
    for (int step = 0; step <= steps; ++step) {
      const auto reason = guard.objection(Eigen::VectorXd(path[i - 1] + way * step / steps));
      if (reason && was_free) return WayObjection{false, *reason};
      was_free = was_free || !reason;
    }
  }
  return std::nullopt;
}

// Where to go on a path, from where the arm is. Directions have unit length in joint space.
class Follower {
 public:
  Follower(Path path, const robot::Guard& guard, const FollowOptions& options)
      : path_(std::move(path)), guard_(guard), options_(options) {}

  Eigen::VectorXd wanted(const Eigen::VectorXd& q) {
    while (leg_ + 2 < path_.size() && passed(q)) ++leg_;
    const Eigen::VectorXd along = direction(leg_);
    const double done = along.dot(q - path_[leg_]);
    const double left = (path_[leg_ + 1] - path_[leg_]).norm() - done;
    const Eigen::VectorXd off = path_[leg_] + along * done - q;
    deviation_rad_ = largest(off);
    return along * speed(q, along, left) + kGain * off;
  }
  double deviationRad() const { return deviation_rad_; }
  bool there(const Eigen::VectorXd& q) const { return largest(q - path_.back()) < kThereRad; }
  // Length of the path that is behind.
  double done(const Eigen::VectorXd& q) const {
    double sum = direction(leg_).dot(q - path_[leg_]);
    for (std::size_t i = 0; i < leg_; ++i) sum += (path_[i + 1] - path_[i]).norm();
    return sum;
  }

 private:
  Eigen::VectorXd direction(std::size_t leg) const { return (path_[leg + 1] - path_[leg]).normalized(); }
  bool straightAfter(std::size_t leg) const {
    return leg + 2 < path_.size() && direction(leg).dot(direction(leg + 1)) > kStraightCosine;
  }
  bool passed(const Eigen::VectorXd& q) const {
    const Eigen::VectorXd& corner = path_[leg_ + 1];
    if (straightAfter(leg_)) return direction(leg_).dot(corner - q) < kCornerRad;
    return largest(corner - q) < kCornerRad;
  }

  // Along the path: as fast as the limits of the flange and the joints allow, and braking before the next
  // corner that is one.
  double speed(const Eigen::VectorXd& q, const Eigen::VectorXd& along, double left) const {
    const MotionLimits& limits = guard_.limits();
    const Eigen::VectorXd twist = guard_.kinematics().jacobian(q) * along;
    const double linear = twist.head<3>().norm(), angular = twist.tail<3>().norm(), joint = largest(along);
    double limit = 1.0 / std::max({linear / limits.max_speed_mps, angular / limits.max_angular_speed_radps,
                                   joint / limits.max_joint_speed_radps});
    limit *= options_.speed_share;
    if (options_.max_joint_speed_radps) limit = std::min(limit, *options_.max_joint_speed_radps / joint);
    const double acceleration = kBrakingShare / std::max({linear / limits.max_acceleration_mps2,
                                                          angular / limits.max_angular_acceleration_radps2,
                                                          joint / limits.max_angular_acceleration_radps2});
    for (std::size_t leg = leg_; straightAfter(leg); ++leg) left += (path_[leg + 2] - path_[leg + 1]).norm();
    return std::copysign(speedAt(std::abs(left), limit, acceleration, kGain), left);
  }

  Path path_;
  const robot::Guard& guard_;
  const FollowOptions& options_;
  std::size_t leg_ = 0;
  double deviation_rad_ = 0.0;
};

}  // namespace

DriveOutcome followPath(robot::Guard& guard, Clock& clock, const std::vector<Eigen::VectorXd>& path,
                        const FollowOptions& options) {
  requireUsable(guard, path, options);
  const StopOnExit stop(guard);
  const Instant start = clock.now();
  const auto end = [&](DriveStatus status, const std::string& reason) {
    guard.stopAndWait();
    DriveOutcome outcome;
    outcome.status = status;
    outcome.reason = reason;
    outcome.elapsed = clock.now() - start;
    return outcome;
  };

  if (guard.operatorStopped()) return end(DriveStatus::kStopped, "The operator asked to stop.");
  const Eigen::VectorXd first = guard.state().q;
  if (first.size() != path.front().size() || !(largest(first - path.front()) <= options.start_within_rad))
    return end(DriveStatus::kLimit, "The arm does not stand where the path begins.");
  const Path way = withoutRepeats(first, path);
  if (const auto objection = objectionAlong(guard, way))
    return end(objection->goal ? DriveStatus::kUnreachable : DriveStatus::kLimit, objection->reason);

  Follower follower(way, guard, options);
  RefusalTimer refusals;
  Instant watched = start, progress = start;
  double farthest = 0.0;
  for (;;) {
    const Eigen::VectorXd q = guard.state().q;
    if (q.allFinite()) {
      if (follower.there(q)) return end(DriveStatus::kReached, "The arm is there.");
      if (follower.done(q) > farthest + kProgressRad) {
        farthest = follower.done(q);
        progress = clock.now();
      }
    }
    const robot::GuardVerdict verdict = guard.commandJoints(q.allFinite() ? follower.wanted(q) : q);
    if (verdict.rule == robot::GuardRule::kOperatorStop) return end(DriveStatus::kStopped, verdict.reason);
    if (refusals.lasted(verdict, clock.now())) return end(DriveStatus::kLimit, verdict.reason);
    if (follower.deviationRad() > options.max_deviation_rad)
      return end(DriveStatus::kLimit, "The arm left the path; it does not follow its commands.");
    if (clock.now() - progress > options.stuck_after)
      return end(DriveStatus::kLimit,
                 verdict.reason.empty() ? "The arm does not move along the path." : verdict.reason);
    if (options.watch && clock.now() - watched >= options.watch_every) {
      if (const auto reason = options.watch()) return end(DriveStatus::kStopped, *reason);
      watched = clock.now();
    }
    clock.sleepFor(kTick);
  }
}

}  // namespace servocal::servo
