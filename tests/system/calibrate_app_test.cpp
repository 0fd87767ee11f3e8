// SPDX-License-Identifier: GPL-3.0-or-later
// servocal-calibrate as a person runs it: exit codes and what is left behind.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "run_program.h"
#include "servocal/session/session.h"

namespace servocal {
namespace {

using test::runProgram;
using test::shellWord;

const std::string kCalibrate = SERVOCAL_CALIBRATE;

std::string defaultCellText() {
  std::ostringstream text;
  text << std::ifstream(SERVOCAL_DEFAULT_CELL).rdbuf();
  return text.str();
}

TEST(CalibrateApp, NeedsAFolderForTheSession) {
  const auto run = runProgram(kCalibrate);
  EXPECT_EQ(run.exit_code, 2) << run.err;
  EXPECT_NE(run.err.find("--out"), std::string::npos);
  EXPECT_EQ(runProgram(kCalibrate + " --out x --no-such-flag").exit_code, 2);
}

TEST(CalibrateApp, HelpSaysWhetherItMovesARobotAndTheExitCodes) {
  const auto run = runProgram(kCalibrate + " --help");
  EXPECT_EQ(run.exit_code, 0);
  EXPECT_NE(run.out.find("Moves the arm: the simulated one at once, a real one only with --arm"), std::string::npos);
  EXPECT_NE(run.out.find("9 refused to move"), std::string::npos);
}

TEST(CalibrateApp, RefusesAMisspeltKeyWithFileLineAndTheNearestOne) {
  const test::TemporaryFolder folder;
  std::string text = defaultCellText();
  const std::string key = "near_distance_m";
  text.replace(text.find(key), key.size(), "near_distanc_m");
  const auto cell = folder.write("cell.yaml", text);
  const auto run = runProgram(kCalibrate + " " + shellWord(cell.string()) + " --out " + shellWord((folder / "session").string()));
  EXPECT_EQ(run.exit_code, 3);
  EXPECT_NE(run.err.find("cell.yaml:"), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("near_distance_m"), std::string::npos) << run.err;
  EXPECT_FALSE(std::filesystem::exists(folder / "session"));
}

TEST(CalibrateApp, DoesNotWriteIntoAnotherSession) {
  const test::TemporaryFolder folder;
  { session::Session::create(folder / "session", "", BoardSpec{}, 1); }
  const auto run = runProgram(kCalibrate + " --out " + shellWord((folder / "session").string()));
  EXPECT_EQ(run.exit_code, 8);
  EXPECT_NE(run.err.find("session"), std::string::npos);
}

TEST(CalibrateApp, AnInterruptStopsTheArmAndKeepsWhatWasObserved) {
  const test::TemporaryFolder folder;
  const auto run =
      runProgram("timeout --preserve-status --signal=INT 20 " + kCalibrate + " --out " + shellWord((folder / "session").string()) + " --seed 2");

  EXPECT_EQ(run.exit_code, 7) << run.err;
  EXPECT_NE(run.err.find("Stopped by the operator. The arm stands still"), std::string::npos) << run.err;
  const auto session = session::Session::open(folder / "session");
  EXPECT_FALSE(session.observations().empty());
  const auto log = session.events();
  EXPECT_EQ(log.front().kind, "begin");
  EXPECT_TRUE(std::any_of(log.begin(), log.end(), [](const auto& line) {
    return line.kind == "interrupted" && line.message.find("Stopped by the operator") == 0;
  }));
}

}  // namespace
}  // namespace servocal
