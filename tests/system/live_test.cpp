// SPDX-License-Identifier: GPL-3.0-or-later
// The live page of a run in a browser, and the program's own options for it.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "cells.h"
#include "live_run.h"
#include "run_program.h"
#include "sim_truth.h"

namespace servocal {
namespace {

using test::runProgram;
using test::shellWord;

// One run at the pace of the wall clock, watched and then stopped by Chromium as by a person.
TEST(LivePage, ShowsTheRunInABrowserAndItsButtonStopsTheArm) {
  if (runProgram("chromium --version").exit_code != 0) GTEST_SKIP() << "chromium is not installed";
  const test::TemporaryFolder folder;
  test::LiveRun run(test::oneCameraCell(), folder / "session");
  test::LiveRunOutcome outcome;
  std::thread loop([&] { outcome = run.run(fromSeconds(150)); });
  const char* pictures = std::getenv("SERVOCAL_LIVE_PICTURES");
  const auto browser = runProgram("timeout 200 python3 " SERVOCAL_LIVE_BROWSER " " + shellWord(run.url()) +
                                  " " + shellWord((folder / "profile").string()) +
                                  (pictures ? " " + shellWord(pictures) : std::string()));
  loop.join();
  ASSERT_EQ(browser.exit_code, 0) << browser.err;
  const auto seen = nlohmann::json::parse(browser.out);
  EXPECT_GE(seen["images"], 5) << browser.out;
  EXPECT_EQ(seen["decoded"], 960);
  EXPECT_EQ(seen["corners"], 24);
  EXPECT_GT(seen["filled_after"], seen["filled_before"]);
  EXPECT_EQ(seen["goal"], 1) << "a drive's goal was never drawn";
  EXPECT_EQ(seen["wanted"], 6) << "the commanded twist was never shown";
  EXPECT_NE(seen["guard"], "") << "the guard's verdict was never shown";
  EXPECT_EQ(seen["phone_overflow"], 0) << "wider than a phone";
  EXPECT_EQ(seen["complaints"], nlohmann::json::array());
  EXPECT_EQ(seen["strangers"], nlohmann::json::array()) << "the page asked somebody else";

  EXPECT_EQ(seen["moving"], true);
  ASSERT_TRUE(outcome.interrupted);
  ASSERT_TRUE(outcome.stop_heard) << "the run was over before the button was pressed";
  const double heard_s = std::chrono::duration<double>(outcome.stop_heard->time_since_epoch()).count() -
                         seen["pressed_monotonic_s"].get<double>();
  std::cout << "stop: heard " << heard_s << " s after the press, the arm at rest " << outcome.rest_after_s
            << " s later\n";
  EXPECT_GT(heard_s, 0.0);
  EXPECT_LT(heard_s + outcome.rest_after_s, 0.3);
  EXPECT_NE(seen["ending"].get<std::string>().find("Stopped by the operator"), std::string::npos);
  EXPECT_EQ(seen["notice"], seen["ending"]);
  EXPECT_EQ(seen["button"], "STOPPED");
}

// The program itself: serves, can be stopped over the page's own requests, and ends as after Ctrl-C.
TEST(LivePage, TheProgramPrintsTheAddressAndObeysTheStop) {
  const test::TemporaryFolder folder;
  const auto watched =
      runProgram("(" SERVOCAL_CALIBRATE " --live --out " + shellWord((folder / "session").string()) + " 2> " +
                 shellWord((folder / "err").string()) +
                 " & pid=$!\n"
                 "for i in $(seq 100); do grep -q token= " +
                 shellWord((folder / "err").string()) +
                 " && break; sleep 0.1; done\n"
                 "url=$(sed -n 's/^Live page: //p' " +
                 shellWord((folder / "err").string()) +
                 ")\n"
                 "sleep 3\n"
                 "python3 -c 'import sys, urllib.request\n"
                 "home, token = sys.argv[1].split(\"/?token=\")\n"
                 "ask = lambda path, data: urllib.request.urlopen(urllib.request.Request(home + path, data, "
                 "{\"X-Servocal-Token\": token})).read().decode()\n"
                 "print(ask(\"/state\", None)); ask(\"/stop\", b\"\")' \"$url\"\n"
                 "wait $pid; code=$?; cat " +
                 shellWord((folder / "err").string()) + " >&2; exit $code)");
  EXPECT_EQ(watched.exit_code, 7) << watched.err;
  EXPECT_NE(watched.err.find("Stopped by the operator. The arm stands still"), std::string::npos)
      << watched.err;
  const auto state = nlohmann::json::parse(watched.out);
  EXPECT_EQ(state["cell"], "default");
}

std::string slurp(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

// The same run twice: alone, into a pipe; and followed by a client as fast as it can ask, with --json. Both
// see and find the same to the last bit, and say the same.
TEST(LivePage, WatchingChangesNothingAndJsonSaysTheSame) {
  const test::TemporaryFolder folder;
  std::string text = replaced(test::oneCameraCell().text, "max_views: 40",
                              "max_views: 40\n  revisit_views: 4\n  check_views: 2");
  const std::string cell = shellWord(folder.write("cell.yaml", text).string());
  sim::Cell simulation(loadCell(folder / "cell.yaml"), 1);
  CalibrationResult known;
  known.board = test::oneCameraCell().board;
  known.cameras.emplace_back();
  known.cameras[0].camera = "cam1";
  known.cameras[0].intrinsics.camera = sim::Truth(simulation).camera("cam1");
  session::saveResult(folder / "known.yaml", known);
  const std::string command = SERVOCAL_CALIBRATE " " + cell + " --seed 1 --hand-eye-only --intrinsics " +
                              shellWord((folder / "known.yaml").string()) + " --out ";

  const auto alone = runProgram(command + shellWord((folder / "alone").string()));
  ASSERT_EQ(alone.exit_code, 0) << alone.err;
  EXPECT_EQ(alone.err.find_first_of("\r\033"), std::string::npos) << "a pipe got what is for terminals";
  EXPECT_LT(std::count(alone.err.begin(), alone.err.end(), '\n'), 8) << alone.err;

  const std::string err = shellWord((folder / "err").string());
  const auto watched =
      runProgram("(" + command + shellWord((folder / "watched").string()) + " --live --json 2> " + err +
                 " & pid=$!\n"
                 "for i in $(seq 100); do grep -q token= " +
                 err +
                 " && break; sleep 0.1; done\n"
                 "python3 -c 'import json, sys, urllib.request\n"
                 "home, token = sys.argv[1].split(\"/?token=\")\n"
                 "ask = lambda path: urllib.request.urlopen(urllib.request.Request(home + path, None, "
                 "{\"X-Servocal-Token\": token})).read()\n"
                 "looks = 0\n"
                 "while True:\n"
                 "    state = json.loads(ask(\"/state\"))\n"
                 "    if state[\"ending\"]: break\n"
                 "    if state[\"arm\"]: ask(\"/look?camera=cam1&stream=color\"); looks += 1\n"
                 "print(looks, file=sys.stderr)' \"$(sed -n 's/^Live page: //p' " +
                 err +
                 ")\"\n"
                 "wait $pid; exit $?)");
  ASSERT_EQ(watched.exit_code, 0) << watched.err << slurp(folder / "err");
  EXPECT_GT(std::stoi(watched.err), 20) << "nobody watched";

  EXPECT_EQ(slurp(folder / "alone/result.yaml"), slurp(folder / "watched/result.yaml"));
  const auto seen = session::Session::open(folder / "alone").observations();
  const auto seen_watched = session::Session::open(folder / "watched").observations();
  ASSERT_EQ(seen.size(), seen_watched.size());
  for (std::size_t i = 0; i < seen.size(); ++i) {
    EXPECT_EQ(seen[i].robot->q, seen_watched[i].robot->q);
    ASSERT_EQ(seen[i].views.size(), seen_watched[i].views.size());
    EXPECT_EQ(seen[i].views[0].stamp, seen_watched[i].views[0].stamp);
  }

  const std::string summary = replaced(alone.out, (folder / "alone").string(), (folder / "watched").string());
  EXPECT_EQ(summary.rfind("Goal met.\n", 0), 0u) << summary;
  const std::string said = slurp(folder / "err");
  ASSERT_GT(said.size(), summary.size());
  EXPECT_EQ(said.substr(said.size() - summary.size()), summary);
  EXPECT_EQ(watched.out, session::resultJson(session::loadResult(folder / "watched/result.yaml")));
}

TEST(LivePage, AnAddressThatIsNotThisMachinesIsRefused) {
  const test::TemporaryFolder folder;
  const auto run = runProgram(SERVOCAL_CALIBRATE " --live --live-host 203.0.113.7 --out " +
                              shellWord((folder / "session").string()));
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_NE(run.err.find("cannot listen at 203.0.113.7"), std::string::npos) << run.err;
  EXPECT_EQ(runProgram(SERVOCAL_CALIBRATE " --live-host 127.0.0.1 --out x").exit_code, 2);
}

}  // namespace
}  // namespace servocal
