// SPDX-License-Identifier: GPL-3.0-or-later
// servocal-check as a person runs it, on rendered images: a sound cell, a bumped camera, a mount that slipped.
#include <gtest/gtest.h>

#include <filesystem>

#include "cells.h"
#include "errors.h"
#include "run_program.h"

namespace servocal {
namespace {

using test::expectPart;
using test::shellWord;

TEST(CheckApp, SaysWhatMovedAndPutsItRight) {
  const test::TemporaryFolder folder;
  std::string text = test::oneCameraCell().text;
  text.replace(text.find("max_views: 40"), 13, "max_views: 10");
  const auto fault = [&](const std::string& keys) {
    return text + "\n  faults:\n    - {" + keys + ", at_s: 0, rotation_vector_deg: [0, 0, 0]}\n";
  };
  const auto file = [&](const char* name, const std::string& content) {
    return shellWord(folder.write(name, content).string());
  };
  const std::string sound = file("sound.yaml", text);
  const std::string bumped =
      file("bumped.yaml", fault("kind: camera_bump, camera: cam1, translation_m: [0.002, 0.0, 0.0]"));
  const std::string slipped = file("slipped.yaml", fault("kind: mount_slip, translation_m: [0.0, 0.002, 0.0]"));
  const std::string out = shellWord((folder / "run").string());
  const auto calibrated = test::runProgram(SERVOCAL_CALIBRATE " " + sound + " --seed 3 --out " + out);
  ASSERT_TRUE(std::filesystem::exists(folder / "run/result.yaml")) << calibrated.err;

  const std::string with = " --seed 3 --result " + out + "/result.yaml";
  const auto quiet = test::runProgram(SERVOCAL_CHECK " " + sound + with);
  EXPECT_EQ(quiet.exit_code, 0) << quiet.out << quiet.err;
  expectPart(quiet.out, "OK: nothing");
  const auto slip = test::runProgram(SERVOCAL_CHECK " " + slipped + with);
  EXPECT_EQ(slip.exit_code, 4) << slip.out;
  expectPart(slip.out, "The board moved on its mount by ");
  const auto bump = test::runProgram(SERVOCAL_CHECK " " + bumped + with + " --repair");
  EXPECT_EQ(bump.exit_code, 0) << bump.out;
  expectPart(bump.out, "Camera 'cam1' moved by ");
  const auto after = test::runProgram(SERVOCAL_CHECK " " + bumped + with);
  EXPECT_EQ(after.exit_code, 0) << after.out;
  expectPart(after.out, "OK: nothing");
  EXPECT_TRUE(std::filesystem::exists(folder / "run/result.yaml.before-repair"));
  EXPECT_TRUE(std::filesystem::exists(folder / "run/check-4/session.sqlite"));
}

}  // namespace
}  // namespace servocal
