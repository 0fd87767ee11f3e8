// SPDX-License-Identifier: GPL-3.0-or-later
// The paper's three cameras, each opened through the real libOpenNI2 from our plug-in, and the arm through
// our RTDE client against the simulated controller, in one command; with fewer goals than in docs/results.md
// (tests/bench/wire_bench).
#include <gtest/gtest.h>

#include <cstdio>

#include "errors.h"
#include "servocal/session/session.h"
#include "servocal/sim/cell.h"
#include "trial.h"
#include "ur_program.h"

namespace servocal {
namespace {

constexpr std::uint64_t kSeed = 1;

std::string fewerGoals() {
  std::string text = loadCell(SERVOCAL_CELLS "/ur_paper.yaml").text;
  const auto change = [&](const std::string& from, const std::string& to) {
    ASSERT_NE(text.find(from), std::string::npos) << from;
    text.replace(text.find(from), from.size(), to);
  };
  change("cells_x: 8", "cells_x: 3");
  change("cells_y: 5", "cells_y: 2\n  infrared_cells_x: 3\n  infrared_cells_y: 2");
  change("max_views: 40", "max_views: 12\n  revisit_views: 4");
  return text;
}

TEST(UrPaper, ThreeCamerasAreCalibratedThroughOpenNi2AndRtde) {
  const test::TemporaryFolder folder;
  const auto file = folder.write("cell.yaml", fewerGoals());
  test::TerminalProgram program(test::urCommand(SERVOCAL_CALIBRATE, file, kSeed, folder / "session"));
  ASSERT_TRUE(program.waitFor(test::kUrPrompt, 120.0)) << program.screen();
  program.type(test::kUrSerial);
  EXPECT_EQ(program.end(1500.0), 0) << program.screen();
  const CalibrationResult result = session::loadResult(folder / "session" / "result.yaml");
  sim::Cell cell(test::withoutController(loadCell(file)), kSeed);
  const auto errors = test::cameraErrors(cell, result);
  ASSERT_EQ(errors.size(), 3u);
  for (const test::CameraErrors& camera : errors) {
    std::printf("%s off by %.2f mm, %.3f deg\n", camera.camera.c_str(), 1e3 * camera.pose_m,
                180.0 / M_PI * camera.pose_rad);
    EXPECT_LT(camera.pose_m, 0.003) << camera.camera;
    EXPECT_TRUE(camera.infrared_m) << camera.camera;
    EXPECT_TRUE(camera.depth_after_m) << camera.camera;
  }
}

}  // namespace
}  // namespace servocal
