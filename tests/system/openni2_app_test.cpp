// SPDX-License-Identifier: GPL-3.0-or-later
// A whole calibration whose images come through the real libOpenNI2.
#include <gtest/gtest.h>

#include "cells.h"
#include "errors.h"
#include "poses.h"
#include "run_program.h"
#include "servocal/session/session.h"
#include "sim_truth.h"

namespace servocal {
namespace {

using test::shellWord;

constexpr std::uint64_t kSeed = 1;

/// The one-camera cell with its camera behind OpenNI2, and few views.
std::string cellText() {
  std::string text = test::oneCameraCell().text;
  const auto change = [&](const std::string& from, const std::string& to) {
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
  };
  change("- name: cam1\n    backend: sim", "- name: cam1\n    backend: openni2");
  change("cells_x: 8", "cells_x: 4");
  change("cells_y: 5", "cells_y: 3");
  change("max_views: 40", "max_views: 20\n  revisit_views: 4");
  return text;
}

std::string calibrate(const test::TemporaryFolder& folder) {
  const auto cell = folder.write("cell.yaml", cellText());
  return std::string(SERVOCAL_CALIBRATE) + " " + shellWord(cell.string()) + " --seed " +
         std::to_string(kSeed) + " --out " + shellWord((folder / "session").string());
}

TEST(OpenNi2Cell, IsCalibratedLikeTheSimulatedOne) {
  const test::TemporaryFolder folder;
  const auto run = test::runProgram("LD_LIBRARY_PATH=" SERVOCAL_OPENNI2_ROOT " " + calibrate(folder));
  EXPECT_EQ(run.exit_code, 0) << run.out << run.err;
  test::expectPart(run.err, "not run on a real camera through OpenNI2");
  const CalibrationResult result = session::loadResult(folder / "session" / "result.yaml");
  ASSERT_EQ(result.cameras.size(), 1u);
  ASSERT_TRUE(result.cameras[0].hand_eye);
  sim::Cell cell(parseCell(cellText(), "test"), kSeed);
  const auto truth = sim::Truth(cell).bMc("cam1");
  const auto& found = result.cameras[0].hand_eye->camera_pose;
  EXPECT_LT((found.translation() - truth.translation()).norm(), 0.003);
  EXPECT_GT((found.translation() - truth.translation()).norm(), 0.0);
}

TEST(OpenNi2Cell, WithoutOurDriverTheSentenceSaysHowToStart) {
  const test::TemporaryFolder folder;
  const auto run = test::runProgram(calibrate(folder));
  EXPECT_EQ(run.exit_code, 5) << run.err;
  test::expectPart(run.err, "LD_LIBRARY_PATH=");
  EXPECT_FALSE(std::filesystem::exists(folder / "session"));
}

}  // namespace
}  // namespace servocal
