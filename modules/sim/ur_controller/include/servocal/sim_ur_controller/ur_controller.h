// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace servocal::sim {

/// What the controller does wrong, or what happens to the arm, on command.
enum class UrFault {
  // While somebody connects
  kOldProtocol,       ///< Refuses RTDE protocol version 2.
  kMissingVariable,   ///< Does not know tcp_offset.
  kTrailingComma,     ///< Ends lists of types with a comma.
  kEmptyType,         ///< Lists of types have a hole.
  kTextMidHandshake,  ///< A text message before every reply.
  kDataBeforeStart,   ///< Data overtake the reply to "start".
  kRefusesStart,
  kJustBooted,       ///< Its clock says 12 s.
  kUnansweredStart,  ///< "start" is accepted, no data follow.
  kForeignReply,     ///< Answers the request of the version with another package.
  // On the wire, any time
  kSplitPackages,    ///< A byte at a time.
  kMergedPackages,   ///< Four data packages in one piece.
  kOversizePackage,  ///< Data packages are four bytes too long.
  kOversizeHeader,   ///< A header that claims 65535 bytes.
  kZeroSize,         ///< A header that claims 0 bytes.
  kUnknownType,
  kForeignRecipe,     ///< Data of a recipe nobody asked for.
  kOutOfOrder,        ///< Every second data package comes before its predecessor.
  kRepeatedPackages,  ///< Every data package twice.
  kNotFinite,         ///< A NaN in the joint angles.
  kGarbage,           ///< Random bytes.
  kLate,              ///< Everything 30 ms late.
  kJitter,            ///< Data up to 40 ms late, each as it happens, in order.
  kLossy,             ///< What TCP makes of 10 % loss: one in ten packages comes 200 ms late, either way, and
                      ///< those behind it wait.
  kSilent,            ///< Sends nothing any more.
  kDeaf,              ///< Takes no input any more, as if the cable were cut one way.
  kClosesLink,
  // At the arm
  kProtectiveStop,
  kEmergencyStop,
  kPowerOff,
  kReducedMode,  ///< Somebody stands at the light curtain: slower limits, no stop.
  kTeachButton,
  kSliderZero,
  kSliderHalf,
  kTcpChanged,
  kPayloadChanged,
  kProgramPaused,   ///< At the pendant; behave() resumes.
  kProgramStopped,  ///< At the pendant.
  kOtherProgram,    ///< Somebody else starts a program.
};

/// The arm after one step of the controller.
struct UrStep {
  std::chrono::steady_clock::time_point due;  ///< When it was due; it may have been worked out a little later.
  Eigen::Matrix<double, 6, 1> q;
  Eigen::Isometry3d flange;  ///< As the controller knows it.
};

struct UrControllerOptions {
  unsigned major = 3, minor = 15, bugfix = 8;  ///< PolyScope; from 5 on an e-Series at 500 Hz.
  std::string model = "UR5";
  std::string serial = "2014350123";
  bool tells_serial = true;    ///< Older dashboards do not understand the question.
  bool remote_control = true;  ///< e-Series.
  Eigen::Matrix<double, 6, 1> start_q =
      (Eigen::Matrix<double, 6, 1>() << 2.87, -1.43, 1.98, 2.59, -1.30, 0.0).finished();
  Eigen::Isometry3d tcp_offset = Eigen::Isometry3d::Identity();
  std::uint64_t seed = 1;
  double kinematic_error_m =
      0.002;  ///< How far this arm is from the nominal one, which only its controller knows.
  /// Applied to every uploaded program; for tests that take a line out.
  std::function<std::string(std::string)> edit_program;
  /// Called after every step, in the controller's thread; must be quick.
  std::function<void(const UrStep&)> on_step;
};

/// What really happens, for tests.
struct UrControllerTruth {
  double time_s = 0.0;  ///< The controller's clock.
  Eigen::Matrix<double, 6, 1> q = Eigen::Matrix<double, 6, 1>::Zero();
  Eigen::Isometry3d flange = Eigen::Isometry3d::Identity();
  double tcp_speed_mps = 0.0;
  double joint_speed_radps = 0.0;  ///< Of the fastest joint.
  bool program_runs = false;
  std::string program_text;          ///< The last upload, as it ran.
  bool watchdog_struck = false;      ///< Since the last upload.
  double last_input_s = 0.0;         ///< When the newest input package arrived, by the controller's clock,
  double last_moving_input_s = 0.0;  ///< and the newest that asked for a motion;
  double last_motion_s = 0.0;        ///< when any joint moved last.
  std::size_t late_steps = 0;  ///< Steps this computer was too busy to make in time; the controller's clock
                               ///< stood still meanwhile.
};

/// A Universal Robots controller with a UR5 on loopback ports of its own: RTDE, dashboard and primary
/// interface, running the programs it is sent in an interpreter of the part of URScript that servocal uses.
/// Lives in a thread of its own, in real time. What it is not: the vendor's controller; see the README.
class UrController {
 public:
  explicit UrController(const UrControllerOptions& options = {});
  ~UrController();

  int rtdePort() const;
  int dashboardPort() const;
  int programPort() const;
  void misbehave(UrFault fault);
  void behave();  ///< Ends all faults; a protective stop is released, a paused program goes on.
  UrControllerTruth truth() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::sim
