// SPDX-License-Identifier: GPL-3.0-or-later
// A run that is interrupted and goes on later: nothing is done twice, nothing is lost, the result is as good.
#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <functional>
#include <thread>

#include "cells.h"
#include "errors.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/procedure/check.h"
#include "servocal/session/check.h"
#include "servocal/sim/cell.h"
#include "session_scene.h"
#include "sim_truth.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

/// One camera and so few views that a run is short; its coverage is not complete then.
CellConfig shortRun() {
  CellConfig cell = test::oneCameraCell();
  cell.coverage.max_views = 8;
  cell.coverage.revisit_views = 4;
  cell.coverage.check_views = 2;
  return cell;
}

struct Outcome {
  CalibrationResult result;
  double camera_error_m = 0.0;
};

/// Runs a cell, in a new session or in one that is there, until `stop` says so.
/// @throws what calibrate throws.
Outcome run(const CellConfig& cell, const fs::path& folder, const std::function<bool(const procedure::Event&)>& stop = {},
            const procedure::CalibrateOptions& options = {}) {
  constexpr std::uint64_t kSeed = 3;
  sim::Cell simulation(cell, kSeed);
  const robot::Kinematics kinematics(cell.arm);
  robot::Guard guard(simulation.arm(), kinematics, simulation.clock(), cell);
  procedure::Devices devices{simulation.clock(), guard, {&simulation.camera(cell.cameras[0].name)}};
  auto session = session::isSession(folder) ? session::Session::openForAppend(folder)
                                            : session::Session::create(folder, cell, kSeed);
  Outcome outcome;
  outcome.result = procedure::calibrate(cell, devices, session, [&](const procedure::Event& event) {
    if (stop && stop(event)) guard.operatorStop();
  }, options);
  const sim::Truth truth(simulation);
  if (!outcome.result.cameras.empty() && outcome.result.cameras[0].hand_eye) {
    outcome.camera_error_m =
        distanceM(Pose<Base, Color>(outcome.result.cameras[0].hand_eye->camera_pose), truth.bMc(cell.cameras[0].name));
  }
  return outcome;
}

bool isAt(const procedure::Event& event, const std::string& stage, int done) {
  return event.stage == stage && event.done == done;
}

TEST(Resume, GoesOnWhereItStoppedAndIsAsGood) {
  const CellConfig cell = shortRun();
  const TemporaryFolder folder;
  const Outcome uninterrupted = run(cell, folder / "whole");
  std::vector<Observation> before;
  for (const auto& [stage, done] : {std::pair("tilt", 3), {"cover", 4}, {"revisit", 2}}) {
    const std::string where = stage;
    const int count = done;
    test::expectPart(test::messageOf(ErrorKind::kInterrupted, [&] {
      run(cell, folder / "parts", [&](const procedure::Event& event) { return isAt(event, where, count); });
    }), "Stopped by the operator");
    const auto now = session::Session::open(folder / "parts").observations();
    ASSERT_GT(now.size(), before.size()) << stage;
    for (std::size_t i = 0; i < before.size(); ++i) test::expectSame(now[i], before[i]);
    before = now;
  }
  const Outcome resumed = run(cell, folder / "parts");
  ASSERT_EQ(resumed.result.cameras.size(), 1u);
  EXPECT_EQ(resumed.result.cameras[0].tilt_limits.size(), 6u);
  const auto session = session::Session::open(folder / "parts");
  const auto observations = session.observations();
  const auto taken = [&](const char* stage) {
    return std::count_if(observations.begin(), observations.end(), [&](const auto& o) { return o.stage == stage; });
  };
  EXPECT_EQ(taken("bootstrap"), 10);  // Once.
  EXPECT_EQ(taken("cover"), cell.coverage.max_views);
  EXPECT_EQ(taken("revisit"), cell.coverage.revisit_views);
  EXPECT_EQ(taken("check"), cell.coverage.check_views);
  EXPECT_EQ(taken("resume"), 3 * 3);
  const auto log = session.events();
  EXPECT_EQ(std::count_if(log.begin(), log.end(), [](const auto& line) { return line.kind == "tilt limit"; }), 6);
  // The log tells the parts apart, what ended each, and after which drive the next one began.
  const auto lines = [&](const char* kind) {
    std::vector<std::string> messages;
    for (const auto& line : log) {
      if (line.kind == kind) messages.push_back(line.message);
    }
    return messages;
  };
  ASSERT_EQ(lines("begin").size(), 4u);
  EXPECT_EQ(lines("begin").front(), "0");
  EXPECT_LT(std::stoi(lines("begin")[1]), std::stoi(lines("begin")[2]));
  ASSERT_EQ(lines("interrupted").size(), 3u);
  test::expectPart(lines("interrupted")[2], "Stopped by the operator");
  EXPECT_EQ(lines("end").size(), 1u);
  EXPECT_EQ(lines("fault").size(), 0u);
  EXPECT_EQ(lines("stage").front().rfind("bootstrap: ", 0), 0u);

  std::cout << "camera off by " << 1e3 * uninterrupted.camera_error_m << " mm uninterrupted, "
            << 1e3 * resumed.camera_error_m << " mm interrupted three times\n";
  // The arm's own error is 0.3 mm.
  EXPECT_LT(resumed.camera_error_m, std::max(1.5 * uninterrupted.camera_error_m, 0.0006));

  // A session that is complete is solved again without another view but those that look whether anything moved.
  const auto cover_before = taken("cover");
  run(cell, folder / "parts");
  const auto after = session::Session::open(folder / "parts").observations();
  EXPECT_EQ(std::count_if(after.begin(), after.end(), [](const auto& o) { return o.stage == "cover"; }), cover_before);
}

TEST(Resume, RefusesWhatIsNotTheSameCellAnymore) {
  CellConfig cell = shortRun();
  const TemporaryFolder folder;
  test::messageOf(ErrorKind::kInterrupted, [&] {
    run(cell, folder / "run", [](const procedure::Event& event) { return isAt(event, "cover", 3); });
  });
  const std::size_t before = session::Session::open(folder / "run").observations().size();
  procedure::CalibrateOptions other;
  other.cameras = {cell.cameras[0].name};
  test::expectPart(test::messageOf(ErrorKind::kRefusedToMove, [&] { run(cell, folder / "run", {}, other); }),
                   "begun with other options");
  fs::copy(folder / "run", folder / "other", fs::copy_options::recursive);
  const auto sql = [](const fs::path& file, const char* text) {
    sqlite3* handle = nullptr;
    ASSERT_EQ(sqlite3_open(file.c_str(), &handle), SQLITE_OK);
    ASSERT_EQ(sqlite3_exec(handle, text, nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(handle);
  };
  sql(folder / "other/session.sqlite", "UPDATE event SET message = 'arm ur5 77' WHERE message LIKE 'arm %'");
  test::expectPart(test::messageOf(ErrorKind::kRefusedToMove, [&] { run(cell, folder / "other"); }),
                   "is none of the session's devices (arm ur5 77, ");
  SimulationFault fault;
  fault.kind = FaultKind::kCameraBump;
  fault.camera = cell.cameras[0].name;
  fault.translation_m = {0.004, 0.0, 0.0};
  cell.simulation->faults.push_back(fault);
  test::expectPart(test::messageOf(ErrorKind::kBadData, [&] { run(cell, folder / "run"); }),
                   "something moved since it was interrupted");
  EXPECT_LE(session::Session::open(folder / "run").observations().size(), before + 3);
}

/// Starts servocal-calibrate, kills it after a while, and says whether it had ended by itself.
bool endsBeforeItIsKilled(const std::vector<std::string>& arguments, std::chrono::milliseconds lifetime) {
  const pid_t child = fork();
  if (child == 0) {
    std::vector<char*> words = {const_cast<char*>(SERVOCAL_CALIBRATE)};
    for (const std::string& argument : arguments) words.push_back(const_cast<char*>(argument.c_str()));
    words.push_back(nullptr);
    execv(words[0], words.data());
    _exit(99);
  }
  const auto end = std::chrono::steady_clock::now() + lifetime;
  int status = 0;
  while (std::chrono::steady_clock::now() < end) {
    if (waitpid(child, &status, WNOHANG) == child) {
      return WIFEXITED(status) && (WEXITSTATUS(status) == 0 || WEXITSTATUS(status) == 4);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  kill(child, SIGKILL);
  waitpid(child, &status, 0);
  return false;
}

TEST(Resume, AProgramThatIsKilledAgainAndAgainArrivesInTheEnd) {
  const TemporaryFolder folder;
  std::string text = test::oneCameraCell().text;
  text.replace(text.find("max_views: 40"), 13, "max_views: 8 ");
  const auto cell = folder.write("cell.yaml", text).string();
  const std::string out = (folder / "run").string();
  std::mt19937 random(4);
  std::size_t before = 0;
  for (int kills = 0; kills < 4; ++kills) {
    const auto lifetime = std::chrono::milliseconds(6000 + random() % 9000);
    const bool fresh = !session::isSession(out);
    const std::vector<std::string> arguments =
        fresh ? std::vector<std::string>{cell, "--out", out, "--seed", "5"} : std::vector<std::string>{"--resume", out};
    if (endsBeforeItIsKilled(arguments, lifetime)) break;
    if (!session::isSession(out)) continue;
    const session::SessionCheck check = session::checkSession(out);
    EXPECT_TRUE(check.whole()) << check.damage.front();
    EXPECT_GE(static_cast<std::size_t>(check.observations), before);
    before = static_cast<std::size_t>(check.observations);
  }
  EXPECT_GT(before, 0u);
  EXPECT_TRUE(fs::exists(folder / "run/result.yaml") ||
              endsBeforeItIsKilled({"--resume", out}, std::chrono::minutes(15)));
  const CalibrationResult result = session::loadResult(folder / "run/result.yaml");
  ASSERT_EQ(result.cameras.size(), 1u);
  EXPECT_TRUE(result.cameras[0].hand_eye);
}

}  // namespace
}  // namespace servocal
