// SPDX-License-Identifier: GPL-3.0-or-later
// The programs with a Universal Robots arm: consent, and a whole calibration through the real libOpenNI2 and
// RTDE against the simulated controller.
#include <gtest/gtest.h>

#include <iostream>
#include <regex>
#include <thread>

#include "cells.h"
#include "errors.h"
#include "servocal/session/session.h"
#include "sim_truth.h"
#include "ur_program.h"

namespace servocal {
namespace {

using test::shellWord;
using test::TerminalProgram;

constexpr std::uint64_t kSeed = 1;
constexpr const char* kPrompt = test::kUrPrompt;
constexpr const char* kSerial = test::kUrSerial;

CellConfig urCell() { return loadCell(SERVOCAL_CELLS "/ur_one_camera.yaml"); }

std::string calibrate(const std::filesystem::path& cell, const test::TemporaryFolder& folder,
                      const std::string& more = " --arm") {
  return test::urCommand(SERVOCAL_CALIBRATE, cell, kSeed, folder / "session", more);
}

/// The camera looks away, so the arm turns round for half a minute looking for it.
std::string searchingCell() {
  std::string text = urCell().text;
  const std::string where = "\nlimits:";
  text.insert(
      text.find(where),
      "  search:\n    posture_deg: [-82.1, 113.6, 148.5, -74.5, 0]\n    first_joint_deg: [164.5, 130]\n");
  return text + "  faults:\n    - kind: camera_turned_away\n      camera: cam1\n";
}

bool isRecorded(const session::Session& session, const std::string& part) {
  for (const session::SessionEvent& event : session.events()) {
    if (event.message.find(part) != std::string::npos) return true;
  }
  return false;
}
const std::filesystem::path kCell = SERVOCAL_CELLS "/ur_one_camera.yaml";

TEST(UrConsent, WithoutTheFlagNothingIsConnectedTo) {
  const test::TemporaryFolder folder;
  const auto run = test::runProgram(calibrate(kCell, folder, ""));
  EXPECT_EQ(run.exit_code, 9) << run.err;
  test::expectPart(run.err, "--arm");
  EXPECT_FALSE(std::filesystem::exists(folder / "session"));
}

TEST(UrConsent, WithoutATerminalNobodyCanConsent) {
  const test::TemporaryFolder folder;
  for (const std::string program : {SERVOCAL_CALIBRATE, SERVOCAL_CHECK " --result nothing.yaml"}) {
    const auto run = test::runProgram("echo 2014350123 | " + program + " " + shellWord(kCell.string()) +
                                      " --arm --out " + shellWord((folder / "session").string()));
    EXPECT_EQ(run.exit_code, 9) << run.err;
    test::expectPart(run.err, "terminal");
    EXPECT_FALSE(std::filesystem::exists(folder / "session"));
  }
}

TEST(UrConsent, TheOperatorReadsWhatIsGoingToMoveAndAnotherAnswerIsRefused) {
  const test::TemporaryFolder folder;
  TerminalProgram program(calibrate(kCell, folder));
  ASSERT_TRUE(program.waitFor(kPrompt, 60.0)) << program.screen();
  for (const char* part :
       {"127.0.0.1:", "UR5", "2014350123", "250 mm/s", "\"arm base\"", "\"camera\"",
        "Not run on a real Universal Robots arm", "Simulated controller: nothing real moves"}) {
    test::expectPart(program.screen(), part);
  }
  program.type("yes\n");
  EXPECT_EQ(program.end(60.0), 9) << program.screen();
  EXPECT_FALSE(std::filesystem::exists(folder / "session"));
}

TEST(UrConsent, WhatWasTypedBeforeTheQuestionIsNoAnswer) {
  const test::TemporaryFolder folder;
  TerminalProgram program(calibrate(kCell, folder), kSerial);
  ASSERT_TRUE(program.waitFor(kPrompt, 60.0)) << program.screen();
  program.type("no\n");
  EXPECT_EQ(program.end(60.0), 9) << program.screen();
}

TEST(UrConsent, TheFlagIsRefusedForASimulatedArm) {
  const auto run = test::runProgram(SERVOCAL_CALIBRATE " --arm --out nowhere");
  EXPECT_EQ(run.exit_code, 2) << run.err;
}

TEST(UrCell, IsCalibratedThroughOpenNi2AndRtdeLikeTheSimulatedOne) {
  const test::TemporaryFolder folder;
  TerminalProgram program(calibrate(kCell, folder));
  ASSERT_TRUE(program.waitFor(kPrompt, 60.0)) << program.screen();
  program.type(kSerial);
  EXPECT_EQ(program.end(400.0), 0) << program.screen();
  const CalibrationResult result = session::loadResult(folder / "session" / "result.yaml");
  test::expectPart(result.provenance, "simulated UR5 2014350123");
  ASSERT_EQ(result.cameras.size(), 1u);
  ASSERT_TRUE(result.cameras[0].hand_eye);
  sim::Cell cell(test::withoutController(urCell()), kSeed);
  const sim::Truth truth(cell);
  const Pose<Base, Color> found(result.cameras[0].hand_eye->camera_pose);
  const double error_m = distanceM(found, truth.bMc("cam1"));
  std::cout << "camera off by " << 1e3 * error_m << " mm\n";
  EXPECT_LT(error_m, 0.003);
  EXPECT_GT(error_m, 0.0);
  EXPECT_TRUE(isRecorded(session::Session::open(folder / "session"), "packages"));

  // And is found as it was calibrated, by the same way.
  TerminalProgram check(
      test::urCommand(SERVOCAL_CHECK, kCell, kSeed, folder / "check",
                      " --arm --result " + shellWord((folder / "session/result.yaml").string())));
  ASSERT_TRUE(check.waitFor(kPrompt, 60.0)) << check.screen();
  EXPECT_FALSE(std::filesystem::exists(folder / "check"));
  check.type(kSerial);
  EXPECT_EQ(check.end(200.0), 0) << check.screen();
  test::expectPart(check.screen(), "OK: nothing");
  test::expectPart(check.screen(), "cam1: ");
}

/// Types the serial number and waits until the arm is in the middle of its search.
void waitUntilTheArmTurns(TerminalProgram& program) {
  ASSERT_TRUE(program.waitFor(kPrompt, 60.0)) << program.screen();
  program.type(kSerial);
  ASSERT_TRUE(program.waitFor("the arm looks round", 60.0)) << program.screen();
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
}

TEST(UrCell, CtrlCInMotionStopsTheArmAndKeepsTheSession) {
  const test::TemporaryFolder folder;
  TerminalProgram program(calibrate(folder.write("cell.yaml", searchingCell()), folder));
  ASSERT_NO_FATAL_FAILURE(waitUntilTheArmTurns(program));
  program.type("\x03");  // As the operator does; the terminal makes a signal of it.
  EXPECT_EQ(program.end(30.0), 7) << program.screen();
  test::expectPart(program.screen(), "Stopped by the operator. The arm stands still");
  // The controller was told to end its program, after the arm stood: had it died of the silence, it would say
  // so.
  EXPECT_EQ(program.screen().find("Simulated controller: the program"), std::string::npos)
      << program.screen();
  const auto session = session::Session::open(folder / "session");
  EXPECT_TRUE(isRecorded(session, "safety mode 1, robot mode 7 at the end"));
  EXPECT_EQ(session.cellText(), searchingCell());
}

TEST(UrCell, ADryRunOpensNothingAndNeedsNeitherFlagNorTerminal) {
  const test::TemporaryFolder folder;
  std::string text = urCell().text;
  text.replace(text.find("127.0.0.1"), 9, "192.0.2.1");  // Nobody is there (RFC 5737).
  const auto cell = folder.write("cell.yaml", text);
  const auto run =
      test::runProgram(SERVOCAL_CALIBRATE " --dry-run " + shellWord(cell.string()) + " < /dev/null");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  test::expectPart(run.out, "start pose");
  test::expectPart(run.out, "Stays out of 'arm base'");
  test::expectPart(run.out, "not known before a run");
  EXPECT_EQ(test::runProgram(SERVOCAL_CALIBRATE " --dry-run --out x").exit_code, 2);
}

TEST(UrCell, WhenTheProgramIsKilledInMotionTheControllerStopsTheArm) {
  const test::TemporaryFolder folder;
  TerminalProgram program(calibrate(folder.write("cell.yaml", searchingCell()), folder));
  ASSERT_NO_FATAL_FAILURE(waitUntilTheArmTurns(program));
  program.send(SIGKILL);
  EXPECT_EQ(program.end(30.0), -1);
  std::smatch stood;
  ASSERT_TRUE(std::regex_search(program.screen(), stood,
                                std::regex("stood still ([0-9]+) ms after its last command")))
      << program.screen();
  const int moved_ms = std::stoi(stood[1]);
  EXPECT_GT(moved_ms, 150) << "the arm did not move when the program was killed";
  EXPECT_LT(moved_ms, 300 + 150) << "watchdog and braking";
}

}  // namespace
}  // namespace servocal
