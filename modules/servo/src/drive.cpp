// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/servo/drive.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "approach.h"
#include "divergence.h"
#include "motion_loop.h"
#include "point_servo.h"
#include "trail.h"
#include "view_tracker.h"
#include "visibility.h"

namespace servocal::servo {
namespace {

using robot::GuardRule;
using robot::GuardVerdict;

constexpr Duration kFirstSightWithin = std::chrono::seconds(1);
constexpr Duration kNoFramesFor = std::chrono::seconds(2);
constexpr Duration kSearchAtStart = std::chrono::milliseconds(500);  // At the end of a retreat.
constexpr int kSightsToGoOn = 2;          // In a row, after a loss: one may be a chance hit.
constexpr double kHandOverM = 0.004;      // The feed-forward move ends so near its goal,
constexpr double kHandOverRad = 0.02;
constexpr Duration kForwardStuckFor = std::chrono::milliseconds(200);  // or after the border held it so long.
constexpr double kBorderRatePerS = 5.0;   // Points approach the image margin at this times the distance.
constexpr double kRetreatShare = 0.5;     // Of the speed limits: a slow camera must find the target again.

struct Goal {
  std::vector<ImagePoint> points;
  std::vector<Eigen::Vector2d> pixels;
};

void requireUsable(const std::vector<Eigen::Vector3d>& points_o, const Pose<Color, Board>& cdMo,
                   const CellEstimate& cell) {
  if (points_o.size() < 4) throw std::invalid_argument("drive: at least four target points are needed");
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& point : points_o)
    scatter += (point - points_o[0]) * (point - points_o[0]).transpose();
  if (!scatter.allFinite()) throw std::invalid_argument("drive: a target point is not a number");
  // The second largest extent against the largest, by the invariants of their squares.
  const double sum = scatter.trace(), products = 0.5 * (sum * sum - (scatter * scatter).trace());
  if (!(products > 1e-6 * sum * sum))
    throw std::invalid_argument("drive: the target points lie on a line");
  if (!cdMo.isFinite()) throw std::invalid_argument("drive: the goal is not a number");
  const bool fixed = cell.mount == Mount::kFixed;
  if (fixed ? !cell.eMo.isFinite() || (cell.bMc && !cell.bMc->isFinite())
            : !cell.eMc.isFinite() || (cell.bMo && !cell.bMo->isFinite()))
    throw std::invalid_argument("drive: the mount or the camera pose is not a number");
  if (cell.camera.parameters.size() != parameterCount(cell.camera.lens) ||
      !cell.camera.parameters.allFinite())
    throw std::invalid_argument("drive: the camera model is incomplete");
}

std::string sentence(const char* format, double a, double b = 0.0) {
  char text[240];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

// One drive. Phases follow each other from top to bottom, except that a loss leads back to kForward or
// kServo when the target is found again.
class Run {
 public:
  Run(robot::Guard& guard, Clock& clock, Observer& observer, const std::vector<Eigen::Vector3d>& points_o,
      const Pose<Color, Board>& cdMo, const CellEstimate& cell, const DriveOptions& options)
      : guard_(guard), clock_(clock), observer_(observer), points_o_(points_o), cdMo_(cdMo), cell_(cell),
        options_(options), tracker_(points_o, cell), start_(clock.now()) {}

  DriveOutcome drive() {
    const StopOnExit stop(guard_);
    if (auto ended = checkGoal()) return *ended;
    for (;;) {
      look();
      if (guard_.operatorStopped()) return end(DriveStatus::kStopped, "The operator asked to stop.");
      if (auto ended = step()) return *ended;
    }
  }

 private:
  const std::vector<Eigen::Vector3d>& visible_o() const {
    return options_.keep_visible_o.empty() ? points_o_ : options_.keep_visible_o;
  }

  enum class Phase { kFirstSight, kForward, kServo, kLost, kRetreat };
  using Ended = std::optional<DriveOutcome>;

  Ended checkGoal() {
    goal_.points = imagePoints(cdMo_, points_o_);
    const auto outside = [&] {
      return end(DriveStatus::kUnreachable, sentence("The goal is not inside the image, %.0f px from its border.",
                                                     options_.image_margin_px));
    };
    for (const Eigen::Vector3d& point_o : points_o_) {
      const std::optional<Eigen::Vector2d> pixel = cell_.camera.project(cdMo_ * point_o);
      if (!pixel) return outside();
      goal_.pixels.push_back(*pixel);
    }
    for (const Eigen::Vector3d& point_o : visible_o()) {
      const std::optional<Eigen::Vector2d> pixel = cell_.camera.project(cdMo_ * point_o);
      if (!pixel || !cell_.camera.contains(*pixel, options_.image_margin_px)) return outside();
    }
    if (guard_.operatorStopped()) return end(DriveStatus::kStopped, "The operator asked to stop.");
    flange_goal_ = cell_.flangeFor(cdMo_);
    if (!flange_goal_) return std::nullopt;
    if (const auto objection = rehearse(guard_, guard_.state(), *flange_goal_))
      return end(objection->goal ? DriveStatus::kUnreachable : DriveStatus::kLimit, objection->reason);
    return std::nullopt;
  }

  // Waits for a frame or the next tick, and remembers what came.
  void look() {
    const Instant deadline = clock_.now() + kTick;
    const Look look = observer_.look(deadline);
    if (!look.frame) {
      clock_.sleepUntil(deadline);
      return;
    }
    if (last_frame_ && *look.frame <= *last_frame_) return;  // Twice the same, or out of order.
    ++frames_;
    last_frame_ = *look.frame;
    last_frame_came_ = clock_.now();
    const bool fresh = clock_.now() - *look.frame < options_.lost_stop;
    stale_ = !fresh;
    seen_now_ = look.sight && fresh && *look.frame <= clock_.now() &&
                tracker_.update(*look.sight, guard_.stateAt(look.sight->stamp).bMe);
    sights_in_a_row_ = seen_now_ ? sights_in_a_row_ + 1 : 0;
    if (!seen_now_) return;
    before_ = std::move(last_);
    last_ = look.sight;
  }

  Ended step() {
    const Instant now = clock_.now();
    const RobotState state = guard_.state();
    if (now - start_ > options_.timeout)
      return end(phase_ == Phase::kServo || phase_ == Phase::kForward ? DriveStatus::kPlateau
                                                                     : DriveStatus::kTargetLost,
                 sentence("The time ran out at %.1f px.", errorPx()));
    if (now - last_frame_came_ > kNoFramesFor && now - start_ > kNoFramesFor)
      return end(DriveStatus::kTargetLost, "No frame came from the camera for 2 s.");
    switch (phase_) {
      case Phase::kFirstSight: return firstSight(now);
      case Phase::kForward:
      case Phase::kServo: return closedLoop(now, state);
      case Phase::kLost: return lost(now, state);
      case Phase::kRetreat: return retreat(now, state);
    }
    return std::nullopt;
  }

  Ended firstSight(Instant now) {
    if (seen_now_) phase_ = flange_goal_ ? Phase::kForward : Phase::kServo;
    else if (now - start_ > kFirstSightWithin)
      return end(DriveStatus::kTargetLost, stale_ ? "Frames of the camera arrive too late to move by them."
                                                  : "The target is not in sight at the start.");
    return std::nullopt;
  }

  Ended closedLoop(Instant now, const RobotState& state) {
    if (now - last_->stamp >= options_.lost_stop) {
      guard_.stopNow();
      ++losses_;
      share_ *= 0.5;
      still_since_.reset();
      seen_now_ = false;  // Only frames after this one tell that it is found again.
      sights_in_a_row_ = 0;
      phase_ = Phase::kLost;
      return std::nullopt;
    }
    trail_.add(state.bMe);

    Twist<EndEffector> wanted;
    if (seen_now_) wanted = wantedTwist(now, state);
    const GuardVerdict verdict = guard_.command(toBase(state.bMe, wanted), last_->stamp);
    if (verdict.rule == GuardRule::kOperatorStop) return end(DriveStatus::kStopped, verdict.reason);
    if (verdict.rule == GuardRule::kStaleFrame) return std::nullopt;  // The next step calls it a loss.
    if (refusals_.lasted(verdict, now)) return end(DriveStatus::kLimit, verdict.reason);
    // The feed-forward does not look at the image: by a wrong bMc it may lead away from a good start.
    if (phase_ == Phase::kForward) divergence_.reset();
    const bool moved = !verdict.refused() && !slow(verdict.applied);
    if (seen_now_ && divergence_.grew(last_->stamp, errorPx(), moved))
      return end(DriveStatus::kLimit,
                 sentence("The arm obeys, yet the target moves away from the goal, from %.0f to %.0f px: its mount, "
                          "a sign or a frame is wrong, or somebody moved target or camera.",
                          divergence_.leastPx(), errorPx()));
    if (!isSettled(now, state, verdict)) return std::nullopt;
    const double error = errorPx();
    if (error <= options_.reached_px)
      return end(DriveStatus::kReached, sentence("Settled %.1f px from the goal.", error));
    return end(DriveStatus::kPlateau,
               sentence(at_border_ ? "Held by the image border %.1f px from the goal."
                                   : "Settled %.1f px from the goal: no motion brings it nearer.",
                        error));
  }

  Twist<EndEffector> wantedTwist(Instant now, const RobotState& state) {
    const View view = tracker_.at(state.bMe);
    const std::optional<PixelMotion> motion = pixelMotion(cell_.camera, view, points_o_);
    const std::optional<PixelMotion> outline = pixelMotion(cell_.camera, view, visible_o());
    if (!motion || !outline) return {};

    Twist<EndEffector> wanted;
    if (phase_ == Phase::kForward) {
      wanted = forwardTwist(state);
      if (distanceM(state.bMe, *flange_goal_) < kHandOverM &&
          angleRad(state.bMe, *flange_goal_) < kHandOverRad)
        phase_ = Phase::kServo;
    }
    if (phase_ == Phase::kServo) wanted = servoTwist(view, *motion);

    const Twist<EndEffector> inside =
        keepInView(wanted, *outline, cell_.camera, options_.image_margin_px, kBorderRatePerS);
    const double change = (inside.linear_mps - wanted.linear_mps).norm() +
                          0.2 * (inside.angular_radps - wanted.angular_radps).norm();
    at_border_ = change > 0.5 * (wanted.linear_mps.norm() + 0.2 * wanted.angular_radps.norm());
    // The straight way is blocked by the border: the law finds its own way in the image.
    if (!at_border_) border_since_.reset();
    else if (!border_since_) border_since_ = now;
    else if (phase_ == Phase::kForward && now - *border_since_ > kForwardStuckFor) phase_ = Phase::kServo;
    return inside;
  }

  Twist<EndEffector> forwardTwist(const RobotState& state) const {
    const Twist<Base> twist = approach(state.bMe, *flange_goal_, guard_.limits(), kRobotGain, share_);
    const Eigen::Matrix3d eRb = state.bMe.rotation().transpose();
    return {eRb * twist.linear_mps, eRb * twist.angular_radps};
  }

  Twist<EndEffector> servoTwist(const View& view, const PixelMotion& motion) {
    const Twist<EndEffector> whole = pointServo(view.points, goal_.points, view.cMe, cell_.mount);
    // What that motion would improve, in pixels: the part of the error that the law can see.
    Eigen::Matrix<double, 6, 1> stacked;
    stacked << whole.linear_mps, whole.angular_radps;
    const double improvement =
        (motion.rates * stacked).norm() / std::sqrt(static_cast<double>(motion.pixels.size()));
    // Fades out between twice and once that error, so that the end is smooth and noise moves nothing.
    const double fade = std::clamp(improvement / options_.still_error_px - 1.0, 0.0, 1.0);
    const double gain = fade * approachGain(whole.linear_mps.norm(), whole.angular_radps.norm(),
                                            guard_.limits(), options_.gain, share_);
    return {gain * whole.linear_mps, gain * whole.angular_radps};
  }

  bool slow(const Twist<Base>& twist) const {
    return twist.linear_mps.norm() < options_.settled_speed_mps &&
           twist.angular_radps.norm() < options_.settled_rate_radps;
  }

  bool isSettled(Instant now, const RobotState& state, const GuardVerdict& verdict) {
    if (!seen_now_) return false;  // A missed frame says nothing about the arm.
    const bool moves = verdict.refused() || !slow(verdict.applied) || !slow(state.twist);
    if (phase_ != Phase::kServo || moves) {
      still_since_.reset();
      return false;
    }
    if (!still_since_) still_since_ = now;
    if (now - *still_since_ < options_.settled_for) return false;
    // Two frames exposed at rest, between which the target's centre does not move.
    if (!before_ || before_->stamp < *still_since_) return false;
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();
    for (std::size_t i = 0; i < points_o_.size(); ++i) shift += last_->pixels[i] - before_->pixels[i];
    return shift.norm() / static_cast<double>(points_o_.size()) < options_.settled_pixel_rate;
  }

  bool framesCome(Instant now) const { return now - last_frame_came_ < options_.lost_stop; }
  bool foundAgain() const { return seen_now_ && sights_in_a_row_ >= kSightsToGoOn; }

  // Target in sight again: go on, or give up here where it is seen.
  Ended goOn() {
    if (losses_ >= options_.lost_tries)
      return end(DriveStatus::kTargetLost, sentence("The target was lost %.0f times on the way.", losses_));
    refusals_.reset();
    divergence_.reset();
    retreat_ended_.reset();
    phase_ = flange_goal_ ? Phase::kForward : Phase::kServo;
    return std::nullopt;
  }

  Ended lost(Instant now, const RobotState&) {
    if (foundAgain()) return goOn();
    // Without frames a retreat would be as blind as going on: wait for them.
    if (now - last_->stamp >= options_.lost_retreat && framesCome(now)) phase_ = Phase::kRetreat;
    return std::nullopt;
  }

  Ended retreat(Instant now, const RobotState& state) {
    if (foundAgain()) return goOn();
    Twist<Base> wanted;
    if (!seen_now_ && framesCome(now)) {  // One sight is a reason to brake, not yet to go on.
      if (const auto back = trail_.back(state.bMe)) {
        wanted = approach(state.bMe, *back, guard_.limits(), kRobotGain, kRetreatShare);
      } else if (!retreat_ended_) {
        retreat_ended_ = now;
      } else if (now - *retreat_ended_ > kSearchAtStart) {
        return end(DriveStatus::kTargetLost, "The target was lost and is not found on the way back either.");
      }
    }
    const GuardVerdict verdict = guard_.command(wanted);
    if (verdict.rule == GuardRule::kOperatorStop) return end(DriveStatus::kStopped, verdict.reason);
    if (refusals_.lasted(verdict, now))
      return end(DriveStatus::kTargetLost,
                 "The target was lost, and the way back is refused: " + verdict.reason);
    return std::nullopt;
  }

  double errorPx() const {
    if (!last_) return 0.0;
    double sum = 0.0;
    for (std::size_t i = 0; i < goal_.pixels.size(); ++i)
      sum += (last_->pixels[i] - goal_.pixels[i]).squaredNorm();
    return std::sqrt(sum / static_cast<double>(goal_.pixels.size()));
  }

  DriveOutcome end(DriveStatus status, const std::string& reason) {
    guard_.stopAndWait();
    DriveOutcome outcome;
    outcome.status = status;
    outcome.reason = reason;
    outcome.last = last_;
    outcome.error_px = errorPx();
    outcome.frames = frames_;
    outcome.losses = losses_;
    outcome.elapsed = clock_.now() - start_;
    return outcome;
  }

  robot::Guard& guard_;
  Clock& clock_;
  Observer& observer_;
  const std::vector<Eigen::Vector3d>& points_o_;
  const Pose<Color, Board> cdMo_;
  const CellEstimate& cell_;
  const DriveOptions& options_;
  ViewTracker tracker_;
  const Instant start_;
  Goal goal_;
  std::optional<Pose<Base, EndEffector>> flange_goal_;

  Phase phase_ = Phase::kFirstSight;
  double share_ = 1.0;      // Of the speed limits; halved by every loss.
  int frames_ = 0;
  int losses_ = 0;
  int sights_in_a_row_ = 0;
  bool seen_now_ = false;   // The newest frame shows the target.
  bool stale_ = false;      // The newest frame was too old when it came.
  bool at_border_ = false;  // The image border holds the target back.
  std::optional<Instant> last_frame_;
  Instant last_frame_came_{};
  std::optional<Sight> last_;
  std::optional<Sight> before_;
  std::optional<Instant> still_since_;
  std::optional<Instant> border_since_;
  std::optional<Instant> retreat_ended_;
  RefusalTimer refusals_;
  DivergenceWatch divergence_;
  Trail trail_;
};

}  // namespace

std::optional<Pose<Base, EndEffector>> CellEstimate::flangeFor(const Pose<Color, Board>& cMo) const {
  if (mount == Mount::kFixed) {
    if (!bMc) return std::nullopt;
    return *bMc * cMo * eMo.inverse();
  }
  if (!bMo) return std::nullopt;
  return *bMo * cMo.inverse() * eMc.inverse();
}

DriveOutcome drive(robot::Guard& guard, Clock& clock, Observer& observer,
                   const std::vector<Eigen::Vector3d>& points_o, const Pose<Color, Board>& cdMo,
                   const CellEstimate& cell, const DriveOptions& options) {
  requireUsable(points_o, cdMo, cell);
  return Run(guard, clock, observer, points_o, cdMo, cell, options).drive();
}

}  // namespace servocal::servo
