// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/core/error.h"
#include "servocal/robot/arm.h"

namespace servocal::robot::ur {

struct Tcp {};  ///< The tool centre point that is active on the controller.

struct ArmOptions {
  double rate_hz = 0.0;  ///< Of states and heartbeats; 0: the controller's own (CB3 125, e-Series 500).
  /// Silence of this program after which the controller stops the arm; 20 ms to 1 s.
  Duration watchdog = std::chrono::milliseconds(100);
  /// Silence of the controller after which it counts as dead; a little margin within 100 ms is left for
  /// waking up.
  Duration dead_peer = std::chrono::milliseconds(80);
  Duration reply_timeout = std::chrono::seconds(2);  ///< Of every question while connecting.
};

/// What was read from the controller when connecting.
struct ControllerFacts {
  std::string address;    ///< "host:port"
  std::string model;      ///< "UR5"
  std::string serial;     ///< Equal to the cell file's.
  std::string polyscope;  ///< Version of the controller's software.
  double rate_hz = 0.0;
  Pose<EndEffector, Tcp> eMtcp;  ///< The active TCP on the flange; divided out of everything.
  double payload_kg = 0.0;
};

/// What happened on the link so far; to be kept with the session.
struct LinkReport {
  std::size_t states = 0;
  std::size_t missed = 0;         ///< Packages the controller's stamps say we never got.
  std::size_t repeated = 0;       ///< Packages with the stamp of the one before; ignored.
  double speed_slider_min = 1.0;  ///< Since the connection. Below 1 every motion is slower than commanded.
  double speed_slider_max = 0.0;
  int safety_mode = 0;                ///< The newest; 1 normal, 2 reduced.
  int robot_mode = 0;                 ///< The newest; 7 running.
  Duration longest_gap{};             ///< Between two arrivals.
  std::optional<Duration> silence;    ///< How old the newest state was when the link was given up.
  std::vector<std::string> messages;  ///< From the controller, newest last, at most 100.
};

/// An arm of Universal Robots (CB3 from PolyScope 3.12.3, e-Series from 5.6) over RTDE. Not run on a real
/// arm: tested against a simulated controller.
///
/// Connecting reads only; nothing can move before arm(). The truth about the flange is the controller's
/// calibrated actual_TCP_pose with the active TCP offset divided out, not nominal kinematics. One thread of
/// its own sends heartbeats and receives states; `clock` is asked from it, so it must be a WallClock.
///
/// A stop (protective stop, pendant, program, TCP offset changed, speed slider at 0) is latched: state() and
/// move() throw until arm() is called again. Nothing here powers the arm, releases brakes or a protective
/// stop.
class Arm final : public robot::Arm {
 public:
  /// @throws Error (kHardwareAbsent) if the controller is not there or not understood; (kRefusedToMove) if it
  /// is
  ///   too old, another program owns the registers, an e-Series is not in remote control, or the serial
  ///   number is not the cell file's.
  /// @throws std::invalid_argument if `config.ur` is empty or an option is out of range.
  Arm(const ArmConfig& config, const MotionLimits& limits, Clock& clock, const ArmOptions& options = {});
  /// Brakes, waits until the arm stands (at most 1 s), ends the program on the controller.
  ~Arm() override;

  const ControllerFacts& facts() const;
  LinkReport report() const;

  /// Uploads the program if it does not run, and arms it. `consent` is what the operator typed after reading
  /// consentText(): the serial number. To be called again after every latched stop, with a consent anew.
  /// @throws Error (kRefusedToMove) if it is not the serial number, or the arm is not ready (powered off,
  /// stopped,
  ///   speed slider at 0); (kHardwareAbsent) if the program does not start, with the controller's reason.
  void arm(const std::string& consent);
  bool armed() const;

  const ArmInfo& info() const override;
  RobotState state() override;
  RobotState stateAt(Instant stamp) override;
  /// @throws Error (kRefusedToMove) before arm(); the latched stop after one.
  void move(MotionKey, const Twist<Base>& twist, Duration valid_for) override;
  void moveJoints(MotionKey, const Eigen::VectorXd& speeds_radps, Duration valid_for) override;
  /// Never throws: a dead link is stopped by the controller's watchdog.
  void stop(MotionKey) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::robot::ur
