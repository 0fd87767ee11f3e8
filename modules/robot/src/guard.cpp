// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot/guard.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <vector>

#include "motion.h"
#include "position_rules.h"
#include "servocal/core/error.h"
#include "twist_limits.h"

namespace servocal::robot {
namespace {

// A command after standing still may change the speed by as much as this long a time allows.
constexpr double kFirstStepS = 0.008;
// m/s, rad/s: what rounding leaves of a motion that braked. It is no motion from which a ramp may go on.
constexpr double kRest = 1e-9;
constexpr double kPeriodS = 0.008;        // Of the commands that brake to a stop.
constexpr double kStillMps = 0.001;       // The arm counts as standing below these
constexpr double kStillRadps = 0.003;
constexpr int kStillStates = 3;           // in so many states in a row.
constexpr double kStopWithinS = 2.0;
constexpr double kRounding = 1.0 + 1e-9;
// Aimed at, so that the arm's turning between two commands does not carry a board corner or a joint over.
constexpr double kSpeedShare = 0.98;
// A motion asked for and slowed down to less than this is a refusal.
constexpr double kCreepMps = 0.002;
constexpr double kCreepRadps = 0.004;

void requirePositive(double value, const char* what) {
  if (!(value > 0.0)) throw std::invalid_argument(std::string("guard: ") + what + " must be positive");
}

void requireNotEmpty(const Box& box) {
  if (!(box.min_m.array() < box.max_m.array()).all())
    throw std::invalid_argument("guard: box '" + box.name + "' is empty");
}

bool isFinite(const RobotState& state) {
  return state.q.allFinite() && state.bMe.isFinite() && state.twist.isFinite();
}

bool creeps(const Motion& motion) {
  if (motion.kind == Motion::Kind::kJoints) return motion.velocity.cwiseAbs().maxCoeff() < kCreepRadps;
  return motion.velocity.head<3>().norm() < kCreepMps && motion.velocity.tail<3>().norm() < kCreepRadps;
}

Motion atRest() { return {Motion::Kind::kTwist, Eigen::VectorXd::Zero(6)}; }

// Braking for dt seconds along its own direction.
Motion braked(const Motion& motion, double braking_s, double dt) {
  return motion.scaled(braking_s > dt ? 1.0 - dt / braking_s : 0.0);
}

std::string milliseconds(Duration duration) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f ms", 1e3 * toSeconds(duration));
  return text;
}

}  // namespace

const char* toString(GuardRule rule) {
  switch (rule) {
    case GuardRule::kNone: return "none";
    case GuardRule::kAcceleration: return "acceleration";
    case GuardRule::kSpeed: return "speed";
    case GuardRule::kJointSpeed: return "joint_speed";
    case GuardRule::kWatchdog: return "watchdog";
    case GuardRule::kJoint: return "joint";
    case GuardRule::kWorkspace: return "workspace";
    case GuardRule::kKeepOut: return "keep_out";
    case GuardRule::kCollision: return "collision";
    case GuardRule::kStaleFrame: return "stale_frame";
    case GuardRule::kNonFinite: return "non_finite";
    case GuardRule::kOperatorStop: return "operator_stop";
  }
  return "unknown";
}

Guard::Guard(Arm& arm, const Kinematics& kinematics, Clock& clock, const MotionLimits& limits,
             const BoardSpec& board, const GuardOptions& options)
    : Guard(arm, kinematics, clock, limits, board, options, std::nullopt) {}

Guard::Guard(Arm& arm, const Kinematics& kinematics, Clock& clock, const CellConfig& cell, const GuardOptions& options)
    : Guard(arm, kinematics, clock, cell.limits, cell.board, options,
            CollisionModel(cell.arm, cell.limits.keep_out, cell.board)) {}

Guard::Guard(Arm& arm, const Kinematics& kinematics, Clock& clock, const MotionLimits& limits,
             const BoardSpec& board, const GuardOptions& options, std::optional<CollisionModel> links)
    : arm_(arm), kinematics_(kinematics), clock_(clock), limits_(limits), options_(options),
      last_applied_(std::make_unique<Motion>(atRest())) {
  requirePositive(limits.max_speed_mps, "max_speed_mps");
  requirePositive(limits.max_angular_speed_radps, "max_angular_speed_radps");
  requirePositive(limits.max_acceleration_mps2, "max_acceleration_mps2");
  requirePositive(limits.max_angular_acceleration_radps2, "max_angular_acceleration_radps2");
  requirePositive(limits.max_joint_speed_radps, "max_joint_speed_radps");
  requirePositive(toSeconds(options.command_timeout), "command_timeout");
  requirePositive(toSeconds(options.max_frame_age), "max_frame_age");
  if (!(limits.joint_margin_rad >= 0.0))
    throw std::invalid_argument("guard: joint_margin_rad must not be negative");
  if (!(options.unknown_board_radius_m >= 0.0))
    throw std::invalid_argument("guard: unknown_board_radius_m must not be negative");
  if (!(options.link_clearance_m >= 0.0))
    throw std::invalid_argument("guard: link_clearance_m must not be negative");
  if (options.look_ahead < options.command_timeout)
    throw std::invalid_argument("guard: look_ahead must not be shorter than command_timeout");
  requireNotEmpty(limits.workspace);
  for (const Box& box : limits.keep_out) requireNotEmpty(box);
  rules_ = std::make_unique<PositionRules>(kinematics, limits, board, options, std::move(links));
}

Guard::~Guard() {
  try {
    arm_.stop(MotionKey());
  } catch (...) {  // The arm is gone; its own watchdog stops it.
  }
}

void Guard::setBoard(const std::optional<Pose<EndEffector, Board>>& eMo) {
  if (eMo && !eMo->isFinite()) throw std::invalid_argument("guard: the board's mount is not a number");
  rules_->setBoard(eMo);
}

void Guard::setObstacles(const std::vector<Sphere>& obstacles) {
  for (const Sphere& sphere : obstacles)
    if (!sphere.center_b.allFinite() || !(sphere.radius_m > 0.0))
      throw std::invalid_argument("guard: obstacle '" + sphere.name + "' is not a sphere");
  rules_->setObstacles(obstacles);
}

GuardVerdict Guard::emergency(const Motion& wanted, GuardRule rule, std::string reason) {
  stopNow();
  GuardVerdict verdict;
  if (wanted.kind == Motion::Kind::kTwist && wanted.velocity.allFinite())
    verdict.wanted = {wanted.velocity.head<3>(), wanted.velocity.tail<3>()};
  verdict.rule = rule;
  verdict.braking = true;
  verdict.reason = std::move(reason);
  return verdict;
}

void Guard::stopNow() {
  noteRest();
  *last_applied_ = atRest();
  arm_.stop(MotionKey());
}

GuardVerdict Guard::noted(GuardVerdict verdict) {
  record_.at = clock_.now();
  record_.newest = verdict;
  if (verdict.rule != GuardRule::kNone) ++record_.interventions[verdict.rule];
  if (verdict.refused()) {
    record_.refused_at = record_.at;
    record_.refused = verdict;
  }
  return verdict;
}

void Guard::noteRest() {
  record_.at = clock_.now();
  record_.newest = {};
}

void Guard::apply(const Motion& motion, Instant now, std::optional<Instant> seen) {
  Duration valid_for = options_.command_timeout;
  if (seen) valid_for = std::min(valid_for, *seen + options_.max_frame_age - now);
  if (motion.kind == Motion::Kind::kJoints)
    arm_.moveJoints(MotionKey(), motion.velocity, valid_for);
  else
    arm_.move(MotionKey(), {motion.velocity.head<3>(), motion.velocity.tail<3>()}, valid_for);
  *last_applied_ = motion;
  last_command_ = now;
  expires_ = now + valid_for;
  if (motion.isZero()) return;
  if (!motion_span_) motion_span_.emplace(now, now);
  motion_span_->second = now;
}

GuardVerdict Guard::command(const Twist<Base>& wanted, std::optional<Instant> seen) {
  return noted(judge({Motion::Kind::kTwist, stacked(wanted)}, seen));
}

GuardVerdict Guard::commandJoints(const Eigen::VectorXd& wanted_radps, std::optional<Instant> seen) {
  if (wanted_radps.size() != kinematics_.joints())
    throw std::invalid_argument("guard: expected " + std::to_string(kinematics_.joints()) + " joint speeds");
  return noted(judge({Motion::Kind::kJoints, wanted_radps}, seen));
}

GuardVerdict Guard::judge(const Motion& wanted, std::optional<Instant> seen) {
  if (operatorStopped()) return emergency(wanted, GuardRule::kOperatorStop, "The operator asked to stop.");
  if (!wanted.velocity.allFinite())
    return emergency(wanted, GuardRule::kNonFinite, "The commanded motion is not a number; the arm was stopped.");
  const RobotState state = arm_.state();
  if (state.q.size() != kinematics_.joints() || !isFinite(state))
    return emergency(wanted, GuardRule::kNonFinite, "The arm's reported state is not a number; it was stopped.");
  const Instant now = clock_.now();
  if (seen && *seen > now)
    return emergency(wanted, GuardRule::kStaleFrame, "The camera frame is from the future (" +
                                                 milliseconds(*seen - now) + "); check the clocks.");
  if (seen && now - *seen >= options_.max_frame_age)
    return emergency(wanted, GuardRule::kStaleFrame, "The camera frame is " + milliseconds(now - *seen) +
                                                 " old; the limit is " +
                                                 milliseconds(options_.max_frame_age) + ".");

  GuardVerdict verdict;
  const auto intervene = [&verdict](GuardRule rule, std::string reason) {
    if (rule < verdict.rule) return;
    verdict.rule = rule;
    verdict.reason = std::move(reason);
  };

  // The state is a little old, and the arm follows late: on its way to another motion it is off that one's path, no
  // joint farther than by what leads off it of the motion before.
  const MotionAt here(kinematics_.jacobian(state.q));
  const double late_s = std::max(0.0, toSeconds(now - state.stamp)) +
                        toSeconds(options_.look_ahead - options_.command_timeout);
  std::vector<Eigen::VectorXd> before_radps;  // As told, and as it moves.
  for (const Motion& motion : {*last_applied_, Motion{Motion::Kind::kTwist, stacked(state.twist)}})
    if (!motion.isZero()) before_radps.push_back(here.joints(motion));
  const auto reachOf = [&](const Motion& motion) {
    const Eigen::VectorXd path_radps = here.joints(motion);
    double off_radps = 0.0;
    for (const Eigen::VectorXd& radps : before_radps) {
      const double along = std::max(0.0, radps.dot(path_radps) / path_radps.squaredNorm());
      const Eigen::VectorXd off = std::isfinite(along) ? Eigen::VectorXd(radps - along * path_radps) : radps;
      off_radps = std::max(off_radps, off.cwiseAbs().maxCoeff());
    }
    return late_s * std::min(off_radps, limits_.max_joint_speed_radps);
  };

  // The ramp starts from what the arm does: nothing, if the last command ran out.
  double dt = toSeconds(now - last_command_);
  if (!last_applied_->isZero() && now > expires_) {
    intervene(GuardRule::kWatchdog, "No command came for " + milliseconds(now - last_command_) +
                                        "; the arm braked and starts again.");
    *last_applied_ = atRest();
  }
  if (last_applied_->velocity.isZero(kRest)) dt = std::min(dt, kFirstStepS);
  if (last_applied_->isZero()) *last_applied_ = wanted.scaled(0.0);
  dt = std::max(dt, 0.0);
  const Motion last = *last_applied_;

  const Eigen::Matrix3d bRe = state.bMe.rotation();
  const auto speedUseOf = [&](const Motion& motion) {
    return speedUse(here.twist(motion), bRe, rules_->body(), limits_);
  };
  const auto jointUseOf = [&](const Motion& motion) {
    if (motion.isZero()) return 0.0;
    return here.joints(motion).cwiseAbs().maxCoeff() * here.speedMargin(motion, reachOf(motion)) /
           limits_.max_joint_speed_radps;
  };
  const auto use = [&](const Motion& motion) { return std::max(speedUseOf(motion), jointUseOf(motion)); };

  Motion target = wanted;
  if (wanted.kind != last.kind) {
    target = last.scaled(0.0);
    intervene(GuardRule::kAcceleration, "Brakes before it moves by another kind of command.");
  }
  if (const double speed_use = speedUseOf(target); speed_use > kSpeedShare) {
    target = target.scaled(kSpeedShare / speed_use);
    if (speed_use > kRounding) intervene(GuardRule::kSpeed, "Slowed down to the speed limits.");
  }
  if (const double joint_use = jointUseOf(target); !std::isfinite(joint_use)) {
    target = target.scaled(0.0);
    intervene(GuardRule::kJoint, "The arm is at a singular pose and cannot move that way.");
  } else if (joint_use > kSpeedShare) {
    target = target.scaled(kSpeedShare / joint_use);
    if (joint_use > kRounding) intervene(GuardRule::kJointSpeed, "Slowed down to the joint speed limit.");
  }

  // Everything between braking and the ramped command obeys the acceleration limits, and the speed
  // limits bound a convex set that holds the braking command: bisect for the most that is allowed.
  const Motion braking = braked(last, here.brakingTime(last, limits_), dt);
  Motion most = target;
  const Motion change{last.kind, target.velocity - last.velocity};
  if (const double change_s = here.brakingTime(change, limits_); change_s > dt)
    most.velocity = last.velocity + (dt / change_s) * change.velocity;
  if (!(most.velocity - target.velocity).isZero(1e-12))
    intervene(GuardRule::kAcceleration, "Ramped to the acceleration limits.");
  const auto between = [&](double share) {
    return Motion{last.kind, braking.velocity + share * (most.velocity - braking.velocity)};
  };
  double share = 1.0;
  if (use(most) > kRounding) {
    double low = 0.0, high = 1.0;
    for (int step = 0; step < 12; ++step) {
      const double middle = 0.5 * (low + high);
      (use(between(middle)) <= kRounding ? low : high) = middle;
    }
    share = low;
  }

  // Positions. Braking needs no look: its curve is the end of the one that was allowed before.
  Motion applied = braking;
  std::optional<Objection> objection;
  for (const double part : {1.0, 0.9, 0.75, 0.5, 0.25, 0.1}) {
    const Motion candidate = between(part * share);
    std::optional<Objection> found =
        rules_->along(state, candidate, toSeconds(options_.look_ahead), reachOf(candidate));
    if (!found) {
      applied = candidate;
      break;
    }
    if (!objection) objection = std::move(found);
  }
  if (objection) intervene(objection->rule, objection->reason);
  const bool hindered = objection || verdict.rule == GuardRule::kJoint || verdict.rule == GuardRule::kJointSpeed;
  verdict.braking = hindered && creeps(applied) && !creeps(wanted);

  apply(applied, now, seen);
  verdict.wanted = here.twist(wanted);
  verdict.applied = here.twist(applied);
  return verdict;
}

void Guard::stopAndWait() {
  noteRest();
  const Instant give_up = clock_.now() + fromSeconds(kStopWithinS);
  while (!last_applied_->isZero() && clock_.now() <= expires_ && !operatorStopped()) {
    const RobotState state = arm_.state();
    if (state.q.size() != kinematics_.joints() || !state.q.allFinite()) break;
    const MotionAt here(kinematics_.jacobian(state.q));
    const Instant now = clock_.now();
    apply(braked(*last_applied_, here.brakingTime(*last_applied_, limits_), toSeconds(now - last_command_)), now,
          std::nullopt);
    if (!last_applied_->isZero()) clock_.sleepFor(fromSeconds(kPeriodS));
  }
  stopNow();
  int still = 0;
  while (still < kStillStates) {
    const RobotState state = arm_.state();
    const bool stands = state.twist.isFinite() && state.twist.linear_mps.norm() < kStillMps &&
                        state.twist.angular_radps.norm() < kStillRadps;
    still = stands ? still + 1 : 0;
    if (still >= kStillStates) break;
    if (clock_.now() > give_up)
      throw Error(ErrorKind::kSafetyStop,
                  "The arm was told to stop 2 s ago and still moves. Stop it by hand and check the link.");
    clock_.sleepFor(fromSeconds(kPeriodS));
  }
}

std::optional<std::string> Guard::objection(const Pose<Base, EndEffector>& bMe) const {
  if (const auto found = rules_->at(bMe)) return found->reason;
  return std::nullopt;
}

std::optional<std::string> Guard::objection(const Eigen::VectorXd& q, double room_m) const {
  if (const auto found = rules_->at(q, room_m)) return found->reason;
  return std::nullopt;
}

}  // namespace servocal::robot
