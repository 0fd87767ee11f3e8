// SPDX-License-Identifier: GPL-3.0-or-later
// A whole calibration whose images come through the real libOpenNI2.
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <opencv2/imgcodecs.hpp>

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

/// The default cell with all cameras behind OpenNI2.
std::string threeCameras() {
  std::string text = defaultCell().text;
  for (const char* name : {"left", "right", "front"}) {
    const std::size_t at = text.find("backend: sim", text.find(std::string("- name: ") + name + " ", text.find("cameras:")));
    text.replace(at, 12, "backend: openni2");
  }
  return text;
}

// OpenNI2's player of recordings leaks, and is unloaded before leaks are counted: tests/lsan.supp could not name it.
#ifdef __SANITIZE_ADDRESS__
constexpr const char* kKeepPlayer = " LD_PRELOAD=" SERVOCAL_OPENNI2_ROOT "/OpenNI2/Drivers/libOniFile.so.0 ";
#else
constexpr const char* kKeepPlayer = " ";
#endif

TEST(Oni, ACameraIsRecordedAndItsImagesAreTakenOut) {
  const test::TemporaryFolder folder;
  const auto oni = [&](const std::string& arguments) {
    return test::runProgram("LD_LIBRARY_PATH=" SERVOCAL_OPENNI2_ROOT + std::string(kKeepPlayer) + SERVOCAL_ONI " " +
                            arguments);
  };
  const std::string cell = shellWord(folder.write("cell.yaml", threeCameras()).string());
  const std::string file = shellWord((folder / "front.oni").string());
  const auto recorded = oni("record " + cell + " --camera front --seconds 4 --out " + file);
  ASSERT_EQ(recorded.exit_code, 0) << recorded.err;
  test::expectPart(recorded.out, "color 640 x 480 px, ");
  test::expectPart(recorded.out, "infrared 640 x 480 px, ");
  test::expectPart(recorded.out, "depth 640 x 480 px, ");
  EXPECT_EQ(oni("show " + file).out, recorded.out);
  const auto again = oni("record " + cell + " --camera front --out " + file);
  EXPECT_EQ(again.exit_code, 2);
  test::expectPart(again.err, "already there");

  const auto images = oni("images " + file + " --every 0.5 --out " + shellWord((folder / "images").string()));
  ASSERT_EQ(images.exit_code, 0) << images.err;
  std::map<std::string, int> count;
  for (const auto& entry : std::filesystem::directory_iterator(folder / "images")) {
    const std::string name = entry.path().filename().string();
    const std::string stream = name.substr(0, name.find('_'));
    ++count[stream];
    const cv::Mat image = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
    EXPECT_EQ(image.size(), cv::Size(640, 480)) << name;
    EXPECT_EQ(image.type(), stream == "color" ? CV_8UC3 : stream == "depth" ? CV_16UC1 : CV_8UC1) << name;
  }
  // Color and infrared of a Kinect v1 exclude each other: half of the four seconds each, less what the change takes.
  for (const char* stream : {"color", "infrared", "depth"}) {
    EXPECT_GE(count[stream], 2) << stream;
    EXPECT_LE(count[stream], 4) << stream;
  }
}

TEST(Oni, WhatIsWrongIsSaid) {
  const test::TemporaryFolder folder;
  const std::string out = " --out " + shellWord((folder / "a.oni").string());
  const auto record = [&](const std::string& text, const std::string& more) {
    return test::runProgram("LD_LIBRARY_PATH=" SERVOCAL_OPENNI2_ROOT " " SERVOCAL_ONI " record " +
                            shellWord(folder.write("cell.yaml", text).string()) + more + out);
  };
  const auto which = record(threeCameras(), "");
  EXPECT_EQ(which.exit_code, 2);
  test::expectPart(which.err, "the cell has: left, right, front");
  const auto other = record(defaultCell().text, " --camera front");
  EXPECT_EQ(other.exit_code, 3);
  test::expectPart(other.err, "only the backend 'openni2' records");
}

}  // namespace
}  // namespace servocal
