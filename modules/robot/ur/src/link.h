// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "history.h"
#include "primary.h"
#include "rtde_client.h"
#include "servocal/robot_ur/arm.h"
#include "stamp_map.h"
#include "watch.h"

namespace servocal::robot::ur {

/// What the arm shall do until `until`; then it holds.
struct Command {
  ScriptMode mode = ScriptMode::kHold;
  Vector6d velocity = Vector6d::Zero();
  Instant until{};
};

/// The driver's one thread: receives states, sends heartbeats and the newest command, watches the controller.
/// Everything else talks to it through this class, whose functions are safe from any thread.
///
/// A soft stop (something at the arm or pendant) is latched and holds the arm, while states and heartbeats go
/// on. A failure of the link ends the thread; its last word is "hold".
class Link {
 public:
  Link(RtdeClient client, Clock& clock, const ArmOptions& options, const ControllerState& first);
  ~Link();

  void command(const Command& command);
  /// What is a stop from now on if it does not hold.
  void expect(const Expected& expected);
  /// The epoch that goes out with every heartbeat; a new one asks the program to arm.
  void announce(int epoch);
  /// Back to the state before arming, unless the link is dead.
  void forgetStop();
  /// The connection over which the program went; must stay open, and tells why the program fails.
  void watchProgram(Socket primary);

  /// The failure or latched stop; nothing while all is well.
  std::optional<Error> stopped() const;
  ControllerState newest() const;
  RobotState state() const;
  RobotState stateAt(Instant stamp) const;
  LinkReport report() const;
  Expected expected() const;
  /// The program's last runtime exception, taken out.
  std::optional<ProgramMessage> takeException();

 private:
  void run();
  void turn();
  void accept(const ControllerState& state, Instant arrival);
  void readProgramMessages();
  void waitForNews(Duration longest) const;
  void wake() const;
  void sendBeat(Instant now);
  Command current(Instant now) const;  ///< Under the lock.
  RobotState toRobotState(const ControllerState& state, Instant stamp) const;
  void note(const std::string& message);

  RtdeClient client_;
  Clock& clock_;
  const ArmOptions options_;
  const Eigen::Isometry3d tcpMe_;
  const double period_s_;
  int wake_descriptor_ = -1;

  // The thread's own.
  StampMap stamps_;
  double echo_stamp_s_ = 0.0;  ///< When the program's sign of life changed last.
  Instant last_arrival_{};
  Instant last_beat_{};
  std::int32_t heartbeat_ = 0;
  std::optional<Socket> primary_;
  PrimaryReader primary_reader_;

  mutable std::mutex mutex_;  // Guards everything below.
  History history_;
  ControllerState newest_;
  Command command_;
  Expected expected_;
  int epoch_ = 0;
  std::optional<Error> stop_;
  bool dead_ = false;  ///< The stop is a failure of the link.
  std::optional<Socket> new_primary_;
  std::optional<ProgramMessage> exception_;
  LinkReport report_;

  std::atomic<bool> quit_{false};
  std::thread thread_;
};

/// A pose as the controller writes it: position, rotation vector.
Eigen::Isometry3d fromVector(const Vector6d& pose);

}  // namespace servocal::robot::ur
