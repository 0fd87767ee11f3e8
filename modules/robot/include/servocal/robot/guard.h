// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/robot/arm.h"
#include "servocal/robot/kinematics.h"

namespace servocal::robot {

/// Why the guard changed or refused a command.
enum class GuardRule {
  kNone,
  kSpeed,         ///< Scaled down to the speed limits.
  kAcceleration,  ///< Ramped.
  kJoint,         ///< Would come too near a joint limit, or a joint would be too fast.
  kWorkspace,     ///< Flange or board would leave the workspace box.
  kKeepOut,       ///< Flange or board would enter a keep-out box.
  kStaleFrame,    ///< The frame the command rests on is too old.
  kNonFinite,     ///< NaN or infinity in the command or the state.
  kWatchdog,      ///< No command for too long; latched until release().
  kOperatorStop,  ///< The operator asked to stop; latched for good.
};
const char* toString(GuardRule rule);

struct GuardOptions {
  Duration command_timeout = std::chrono::milliseconds(100);  ///< The arm brakes after this without a command.
  Duration max_frame_age = std::chrono::milliseconds(150);    ///< Exposure to command, for vision-based ones.
  Duration look_ahead = std::chrono::milliseconds(300);       ///< How far position rules extrapolate.
};

/// What became of a command.
struct GuardVerdict {
  Twist<Base> applied;                  ///< What the arm was told; zero if refused.
  GuardRule rule = GuardRule::kNone;    ///< The strongest rule that intervened.
  std::string reason;                   ///< A sentence for the operator; empty for kNone.
  bool refused() const { return rule >= GuardRule::kJoint; }
};

/// The one object that owns the right to move the arm. Every command of the program goes through
/// command(); it bends to the speed and acceleration limits, refuses what would break a position rule,
/// and stops the arm in its destructor. It is not a safety function in the sense of any standard.
class Guard {
 public:
  /// @throws std::invalid_argument if a limit is not positive or a box is empty.
  Guard(Arm& arm, const Kinematics& kinematics, Clock& clock, const MotionLimits& limits,
        const BoardSpec& board, const GuardOptions& options = {});
  ~Guard();
  Guard(const Guard&) = delete;
  Guard& operator=(const Guard&) = delete;

  /// Where the board sits on the flange, once known: its corners then obey the boxes and the speed
  /// limit too. Before, a sphere of `unknown_board_radius_m` around the flange does. Nothing if the
  /// board is not on the arm.
  void setBoard(const std::optional<Pose<EndEffector, Board>>& eMo);

  /// Asks for a motion. `seen` is the stamp of the frame the command rests on; nothing for a command
  /// that rests on robot states alone (a feed-forward move, a retreat).
  GuardVerdict command(const Twist<Base>& wanted, std::optional<Instant> seen = std::nullopt);
  /// Brakes to a stop within the acceleration limits and waits until the arm stands still.
  /// @throws Error (kSafetyStop) if it does not within 2 s.
  void stopAndWait();
  /// Asks every later command to be refused. Safe from a signal handler and from other threads.
  void operatorStop() { operator_stop_.store(true); }
  bool operatorStopped() const { return operator_stop_.load(); }

  /// True if the flange pose (and the board, if known) obeys boxes and, if given, joint limits.
  bool allows(const Pose<Base, EndEffector>& bMe) const;
  bool allows(const Eigen::VectorXd& q) const;

  RobotState state() { return arm_.state(); }
  RobotState stateAt(Instant stamp) { return arm_.stateAt(stamp); }
  const Kinematics& kinematics() const { return kinematics_; }
  const MotionLimits& limits() const { return limits_; }
  /// First and last instant at which the arm was told to move; nothing before the first.
  std::optional<std::pair<Instant, Instant>> motionSpan() const { return motion_span_; }

 private:
  Arm& arm_;
  const Kinematics& kinematics_;
  Clock& clock_;
  MotionLimits limits_;
  BoardSpec board_;
  GuardOptions options_;
  std::optional<Pose<EndEffector, Board>> eMo_;
  Twist<Base> last_applied_;
  std::optional<Instant> last_command_;
  std::optional<std::pair<Instant, Instant>> motion_span_;
  std::atomic<bool> operator_stop_{false};
};

}  // namespace servocal::robot
