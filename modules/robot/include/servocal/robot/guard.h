// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/robot/arm.h"
#include "servocal/robot/collision.h"
#include "servocal/robot/kinematics.h"

namespace servocal::robot {

struct Motion;

/// Why the guard changed or refused a command; the later, the stronger.
enum class GuardRule {
  kNone,
  kAcceleration,  ///< Ramped.
  kSpeed,         ///< Scaled down to the speed limits.
  kJointSpeed,    ///< Scaled down to the joint speed limit, or near a singularity.
  kWatchdog,      ///< No command for so long that the arm braked by itself; starts again from rest.
  kJoint,         ///< Would come too near a joint limit or a singularity.
  kWorkspace,     ///< Flange or board would leave the workspace box.
  kKeepOut,       ///< Flange or board would enter a keep-out box or an obstacle.
  kCollision,     ///< A link of the arm would come too near to the board, another link, a box or an obstacle.
  kStaleFrame,    ///< The frame the command rests on is too old, or from the future.
  kNonFinite,     ///< NaN or infinity in the command or the state.
  kOperatorStop,  ///< The operator asked to stop; latched for good.
};
const char* toString(GuardRule rule);  ///< "none", "acceleration", "speed", ...

struct GuardOptions {
  Duration command_timeout = std::chrono::milliseconds(100);  ///< The arm brakes after this without a command.
  Duration max_frame_age = std::chrono::milliseconds(150);    ///< Exposure to command, for vision-based ones.
  Duration look_ahead = std::chrono::milliseconds(150);       ///< Position rules extrapolate the command this
                                  ///< far, then brake; at least command_timeout, more by the arm's own lag.
  double unknown_board_radius_m = 0.2;  ///< Kept clear around the flange until setBoard() is called.
  double link_clearance_m = 0.005;      ///< Kept between what must not touch, if the guard watches the links.
};

/// What became of a command.
struct GuardVerdict {
  Twist<Base> wanted;                   ///< What was asked for; for joint speeds the twist they would make. Zero if
                                        ///< it was refused before that could be said.
  Twist<Base> applied;                  ///< What the arm was told; for joint speeds the twist they make.
  GuardRule rule = GuardRule::kNone;    ///< The strongest rule that intervened.
  bool braking = false;                 ///< Refused: the arm brakes to rest, or stays there.
  std::string reason;                   ///< A sentence for the operator; empty for kNone.
  bool refused() const { return braking; }
};

/// What went through a guard so far, for those who watch.
struct GuardRecord {
  std::optional<Instant> at;               ///< Of the newest command, or of the stop that came after it.
  GuardVerdict newest;                     ///< Zero after a stop.
  std::optional<Instant> refused_at;       ///< Of the newest command that was refused,
  GuardVerdict refused;                    ///< and why.
  std::map<GuardRule, int> interventions;  ///< Commands on which each rule was the strongest to intervene.
};

/// The one object that owns the right to move the arm. Every command of the program goes through
/// command() or commandJoints(); it bends to the speed and acceleration limits, slows down and refuses before a position
/// rule breaks, and stops the arm in its destructor. It is not a safety function in the sense of any
/// standard.
///
/// Position rules: a motion is applied only if the curve "hold it for look_ahead, then brake along the same
/// curve" obeys every box and joint limit. Braking from any moment of such a curve stays on it, so there
/// is always a safe way to stop. A rule that is already broken at the start (the arm was left inside a
/// box) allows motion out of it, and none deeper.
///
/// The board counts as its outline and a grid of points at most 40 mm apart: obstacles thinner than that
/// may slip between. Made from a whole cell, the guard watches the arm's links too (CollisionModel), with the
/// same curve.
class Guard {
 public:
  /// @throws std::invalid_argument if a limit is not positive, a box is empty, or look_ahead is shorter
  ///   than command_timeout.
  Guard(Arm& arm, const Kinematics& kinematics, Clock& clock, const MotionLimits& limits,
        const BoardSpec& board, const GuardOptions& options = {});
  /// The same with the cell's limits and board, and watching the arm's links.
  /// @throws Error (kInvalidConfig) as CollisionModel.
  Guard(Arm& arm, const Kinematics& kinematics, Clock& clock, const CellConfig& cell,
        const GuardOptions& options = {});
  ~Guard();
  Guard(const Guard&) = delete;
  Guard& operator=(const Guard&) = delete;

  /// Where the board sits on the flange, once known, even roughly: its points then obey the boxes and the
  /// speed limit too. Nothing if the board is not on the arm. Until the first call, a sphere of
  /// GuardOptions::unknown_board_radius_m around the flange obeys them.
  /// @throws std::invalid_argument if the pose is not finite.
  void setBoard(const std::optional<Pose<EndEffector, Board>>& eMo);

  /// Balls that neither flange nor board nor links may enter, instead of those set before: cameras, once it is
  /// known where they stand.
  /// @throws std::invalid_argument if a center is not finite or a radius not positive.
  void setObstacles(const std::vector<Sphere>& obstacles);

  /// Asks for a motion. `seen` is the stamp of the frame the command rests on; nothing for a command
  /// that rests on robot states alone (a probing move, a retreat). The arm holds the twist until the next
  /// command, at most for command_timeout and at most until that frame is max_frame_age old.
  ///
  /// Position rules brake within the acceleration limits; an operator stop, a stale frame and numbers
  /// that are not finite stop the arm at once.
  /// @throws Error (kHardwareAbsent, kSafetyStop) from the arm.
  GuardVerdict command(const Twist<Base>& wanted, std::optional<Instant> seen = std::nullopt);
  /// The same for joint speeds (rad/s), under the same rules; singular poses are no obstacle to them. No joint
  /// accelerates faster than max_angular_acceleration_radps2. An arm that moves by the other kind of command
  /// brakes to rest first.
  /// @throws std::invalid_argument unless there is one speed per joint.
  GuardVerdict commandJoints(const Eigen::VectorXd& wanted_radps, std::optional<Instant> seen = std::nullopt);
  /// Stops the arm at once, as hard as it can.
  void stopNow();
  /// Brakes to a stop within the acceleration limits and waits until the arm stands still.
  /// @throws Error (kSafetyStop) if it does not within 2 s.
  void stopAndWait();
  /// Asks every later command to be refused. Safe from a signal handler and from other threads.
  void operatorStop() { operator_stop_.store(true); }
  bool operatorStopped() const { return operator_stop_.load(); }

  /// Why flange and board may not be there: a sentence naming the rule; nothing if they may.
  std::optional<std::string> objection(const Pose<Base, EndEffector>& bMe) const;
  /// The same for joint angles, joint limits and links included, with `room_m` more between everything.
  std::optional<std::string> objection(const Eigen::VectorXd& q, double room_m = 0.0) const;
  bool allows(const Pose<Base, EndEffector>& bMe) const { return !objection(bMe); }
  bool allows(const Eigen::VectorXd& q) const { return !objection(q); }

  RobotState state() { return arm_.state(); }
  RobotState stateAt(Instant stamp) { return arm_.stateAt(stamp); }
  const Kinematics& kinematics() const { return kinematics_; }
  const MotionLimits& limits() const { return limits_; }
  const GuardOptions& options() const { return options_; }
  /// Of the commands so far; to be read in the thread that commands.
  const GuardRecord& record() const { return record_; }
  /// First and last instant at which the arm was told to move; nothing before the first.
  std::optional<std::pair<Instant, Instant>> motionSpan() const { return motion_span_; }

 private:
  Guard(Arm& arm, const Kinematics& kinematics, Clock& clock, const MotionLimits& limits, const BoardSpec& board,
        const GuardOptions& options, std::optional<CollisionModel> links);
  GuardVerdict judge(const Motion& wanted, std::optional<Instant> seen);
  GuardVerdict emergency(const Motion& wanted, GuardRule rule, std::string reason);
  GuardVerdict noted(GuardVerdict verdict);
  void noteRest();
  void apply(const Motion& motion, Instant now, std::optional<Instant> seen);

  Arm& arm_;
  const Kinematics& kinematics_;
  Clock& clock_;
  MotionLimits limits_;
  GuardOptions options_;
  std::unique_ptr<class PositionRules> rules_;
  std::unique_ptr<Motion> last_applied_;
  GuardRecord record_;
  Instant last_command_{};
  Instant expires_{};  // When the arm brakes by itself unless told again.
  std::optional<std::pair<Instant, Instant>> motion_span_;
  std::atomic<bool> operator_stop_{false};
};

}  // namespace servocal::robot
