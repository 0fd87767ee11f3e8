// SPDX-License-Identifier: GPL-3.0-or-later
// Connecting and arming: what is refused, and in which words.
#include <gtest/gtest.h>

#include "servocal/robot/kinematics.h"
#include "servocal/robot_ur/consent.h"
#include "ur_cell.h"

namespace servocal::robot::ur {
namespace {

using namespace test;

std::string refusalOf(ErrorKind kind, const UrControllerOptions& options, std::optional<UrFault> fault = {}) {
  UrCell cell(options);
  if (fault) cell.controller.misbehave(*fault);
  ArmOptions impatient = patient();
  if (fault == UrFault::kUnansweredStart) impatient.reply_timeout = std::chrono::milliseconds(500);
  return messageOf(kind, [&] { cell.connected(impatient); });
}

std::string refusalOf(ErrorKind kind, UrFault fault) { return refusalOf(kind, {}, fault); }

TEST(UrConnect, ReadsWhoAnswers) {
  UrControllerOptions options;
  options.tcp_offset.translation() = Eigen::Vector3d(0.01, 0.0, 0.12);
  UrCell cell(options);
  const auto arm = cell.connected();
  const ControllerFacts& facts = arm->facts();
  EXPECT_EQ(facts.model, "UR5");
  EXPECT_EQ(facts.serial, "2014350123");
  EXPECT_EQ(facts.polyscope, "3.15.8");
  EXPECT_EQ(facts.rate_hz, 125.0);
  EXPECT_EQ(facts.payload_kg, 0.5);
  EXPECT_NEAR(facts.eMtcp.translation().z(), 0.12, 1e-12);
  EXPECT_EQ(arm->info().joints, 6);
  EXPECT_EQ(arm->info().serial, "2014350123");
  EXPECT_FALSE(arm->armed());
  // Connecting is reading: no program, no motion.
  EXPECT_FALSE(cell.controller.truth().program_runs);
}

TEST(UrConnect, FlangeIsTheControllersWithTheTcpDividedOut) {
  UrControllerOptions options;
  options.tcp_offset =
      Eigen::Translation3d(0.03, -0.02, 0.15) * Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitY());
  UrCell cell(options);
  const auto arm = cell.connected();
  const RobotState state = arm->state();
  const Pose<Base, EndEffector> truth(cell.controller.truth().flange);
  EXPECT_LT(distanceM(state.bMe, truth), 1e-9);
  EXPECT_LT(angleRad(state.bMe, truth), 1e-9);
  // The arm is 2 mm off its nominal kinematics, so nominal forward kinematics would show.
  const Kinematics nominal(cell.config);
  EXPECT_GT(distanceM(nominal.forward(state.q), truth), 1e-4);
}

TEST(UrConnect, SurvivesWhatIsLegal) {
  for (const UrFault fault : {UrFault::kTextMidHandshake, UrFault::kDataBeforeStart, UrFault::kTrailingComma,
                              UrFault::kSplitPackages, UrFault::kMergedPackages, UrFault::kLate}) {
    UrCell cell;
    cell.controller.misbehave(fault);
    const auto arm = cell.armed();
    EXPECT_FALSE(cell.drive(*arm, UrCell::up(), [&] { return cell.moves(); })) << static_cast<int>(fault);
    EXPECT_TRUE(cell.moves()) << static_cast<int>(fault);
    EXPECT_EQ(arm->report().missed, 0u) << static_cast<int>(fault);
    if (fault == UrFault::kTextMidHandshake) {
      std::string all;
      for (const std::string& message : arm->report().messages) all += message + "\n";
      expectPart(all, "RTDE: RTDE control interface is busy with other things");
    }
  }
}

TEST(UrConnect, RefusesOldOrUnsuitedControllers) {
  UrControllerOptions old;
  old.minor = 9;
  expectPart(refusalOf(ErrorKind::kRefusedToMove, old), "runs PolyScope 3.9.8; this program needs 3.12.3");
  old.major = 5, old.minor = 4, old.bugfix = 0;
  expectPart(refusalOf(ErrorKind::kRefusedToMove, old), "runs PolyScope 5.4.0");
  expectPart(refusalOf(ErrorKind::kRefusedToMove, UrFault::kOldProtocol),
             "runs PolyScope 3.15.8; this program needs");
  expectPart(refusalOf(ErrorKind::kRefusedToMove, UrFault::kMissingVariable),
             "does not know the variable 'tcp_offset'");
  UrControllerOptions mute;
  mute.tells_serial = false;
  expectPart(refusalOf(ErrorKind::kRefusedToMove, mute), "does not understand 'get serial number'");
}

TEST(UrConnect, RefusesBrokenAnswers) {
  expectPart(refusalOf(ErrorKind::kHardwareAbsent, UrFault::kEmptyType), "empty entry");
  expectPart(refusalOf(ErrorKind::kHardwareAbsent, UrFault::kForeignReply),
             "came where the reply of type 'v' was due");
  expectPart(refusalOf(ErrorKind::kHardwareAbsent, UrFault::kRefusesStart), "refused to start the exchange");
  expectPart(refusalOf(ErrorKind::kHardwareAbsent, UrFault::kUnansweredStart),
             "no data came after the start");
  expectPart(refusalOf(ErrorKind::kHardwareAbsent, UrFault::kJustBooted), "started 12 s ago");
  expectPart(refusalOf(ErrorKind::kHardwareAbsent, UrFault::kClosesLink), "closed the connection");
}

TEST(UrConnect, RefusesAnotherArmAndALocalOne) {
  UrCell cell;
  cell.config.ur->serial = "2014350999";
  expectPart(messageOf(ErrorKind::kRefusedToMove, [&] { cell.connected(); }),
             "has the serial number 2014350123, the cell file names 2014350999");
  UrControllerOptions local;
  local.major = 5;
  local.remote_control = false;
  expectPart(refusalOf(ErrorKind::kRefusedToMove, local), "local control");
}

TEST(UrConnect, RefusesRegistersInUse) {
  UrCell cell;
  const auto first = cell.connected();
  expectPart(messageOf(ErrorKind::kRefusedToMove, [&] { cell.connected(); }),
             "already writes the controller's variable 'input_int_register_24'");
}

TEST(UrConnect, NobodyThere) {
  UrCell cell;
  cell.config.ur->rtde_port = 1;
  expectPart(messageOf(ErrorKind::kHardwareAbsent, [&] { cell.connected(); }), "no connection");
  cell.config.ur->host = "no such host";
  expectPart(messageOf(ErrorKind::kHardwareAbsent, [&] { cell.connected(); }), "is not known");
}

TEST(UrArming, NeedsTheSerialNumberTyped) {
  UrCell cell;
  const auto arm = cell.connected();
  for (const char* typed : {"", "yes", "2014350124"}) {
    expectPart(messageOf(ErrorKind::kRefusedToMove, [&] { arm->arm(typed); }), "No consent");
  }
  expectPart(messageOf(ErrorKind::kRefusedToMove,
                       [&] { arm->move(forgedMotionKey(), UrCell::up(), std::chrono::milliseconds(100)); }),
             "nobody gave consent");
  EXPECT_FALSE(cell.controller.truth().program_runs);
  arm->arm("2014350123");
  EXPECT_TRUE(arm->armed());
}

TEST(UrArming, RefusesAnArmThatIsNotReady) {
  const std::pair<UrFault, const char*> cases[] = {{UrFault::kProtectiveStop, "protective stop"},
                                                   {UrFault::kEmergencyStop, "emergency stop"},
                                                   {UrFault::kPowerOff, "not running"},
                                                   {UrFault::kTeachButton, "teach button"},
                                                   {UrFault::kSliderZero, "stands at 0 %"}};
  for (const auto& [fault, part] : cases) {
    UrCell cell;
    const auto arm = cell.connected();
    cell.controller.misbehave(fault);
    cell.clock.sleepFor(std::chrono::milliseconds(200));
    expectPart(messageOf(ErrorKind::kRefusedToMove, [&] { arm->arm("2014350123"); }), part);
    EXPECT_FALSE(cell.controller.truth().program_runs);
  }
}

TEST(UrArming, SaysWhereTheControllerRefusesTheProgram) {
  UrControllerOptions options;
  options.edit_program = [](std::string text) {
    return text.replace(text.find("get_steptime"), 12, "no_such_func");
  };
  UrCell cell(options);
  const auto arm = cell.connected();
  const std::string message = messageOf(ErrorKind::kHardwareAbsent, [&] { arm->arm("2014350123"); });
  expectPart(message, "refused our program at line 1");
  expectPart(message, "compile_error_name_not_found:no_such_func:");
}

TEST(UrConsent, ShowsWhichArmHowFastAndWhereItWillNotGo) {
  UrCell cell;
  const auto arm = cell.connected();
  const std::string text = consentText(arm->facts(), cell.limits);
  for (const char* part :
       {"127.0.0.1:", "UR5, PolyScope 3.15.8", "2014350123", "250 mm/s, 29 deg/s; joints 57 deg/s",
        "\"workspace\": x 0.00 to 1.00", "Stays out of   \"camera\": x 1.00 to 1.30", "\"arm base\"",
        "Not run on a real Universal Robots arm", "not a safety function", "Type the serial number"}) {
    expectPart(text, part);
  }
}

}  // namespace
}  // namespace servocal::robot::ur
