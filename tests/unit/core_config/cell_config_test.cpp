// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/cell_config.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

#include "cells.h"
#include "errors.h"

namespace servocal {
namespace {

using test::expectPart;

/// The one-camera cell with one change in its text, loaded as a file.
class CellFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::temp_directory_path() /
        ("servocal_cell_" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  CellConfig load(const std::string& text) const {
    std::ofstream(folder_ / "cell.yaml") << text;
    return loadCell(folder_ / "cell.yaml");
  }
  /// The refusal of that cell with `from` replaced by `to`, without the folder's name.
  std::string refusal(const std::string& from, const std::string& to) const {
    const std::string message = test::messageOf(ErrorKind::kInvalidConfig, [&] { load(changed(from, to)); });
    const std::string prefix = folder_.string() + "/";
    EXPECT_EQ(message.substr(0, prefix.size()), prefix) << message;
    return message.substr(std::min(prefix.size(), message.size()));
  }
  static std::string changed(const std::string& from, const std::string& to) {
    std::string text = test::oneCameraCell().text;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << "the cell has no '" << from << "'";
    return text.replace(at, from.size(), to);
  }
  /// Line of that cell that holds `part`, as in "cell.yaml:12: ".
  static std::string at(const std::string& part) {
    const std::string text = test::oneCameraCell().text;
    const std::size_t position = text.find(part);
    EXPECT_NE(position, std::string::npos) << part;
    return "cell.yaml:" + std::to_string(1 + std::count(text.begin(), text.begin() + position, '\n')) + ": ";
  }

  std::filesystem::path folder_;
};

TEST(DefaultCell, IsTheFileAndThePapersCell) {
  const CellConfig cell = defaultCell();
  std::ostringstream file;
  file << std::ifstream(SERVOCAL_DEFAULT_CELL).rdbuf();
  EXPECT_EQ(cell.text, file.str());
  EXPECT_TRUE(cell.file.empty());
  EXPECT_EQ(cell.board.as<Checkerboard>()->squares_x, 7);
  EXPECT_EQ(cell.board.as<Checkerboard>()->squares_y, 5);
  EXPECT_EQ(cell.board.spacing(), 0.03);
  EXPECT_TRUE(cell.board.as<Checkerboard>()->hollow_corner);
  EXPECT_EQ(cell.limits.max_speed_mps, 0.25);
  EXPECT_EQ(cell.limits.max_angular_speed_radps, 0.5);
  EXPECT_EQ(cell.limits.max_acceleration_mps2, 1.2);
  ASSERT_EQ(cell.cameras.size(), 3u);
  for (const std::size_t v2 : {0u, 1u}) {
    EXPECT_EQ(cell.cameras[v2].width_px, 1920);
    ASSERT_TRUE(cell.cameras[v2].infrared);
    EXPECT_EQ(cell.cameras[v2].infrared->depth, DepthSensor::kTimeOfFlight);
    EXPECT_FALSE(cell.cameras[v2].infrared->excludes_color);
  }
  ASSERT_TRUE(cell.cameras[2].infrared);
  EXPECT_EQ(cell.cameras[2].infrared->depth, DepthSensor::kStructuredLight);
  EXPECT_TRUE(cell.cameras[2].infrared->excludes_color);
  EXPECT_EQ(cell.arm.start_q.size(), 6);
  ASSERT_TRUE(cell.simulation.has_value());
  EXPECT_NEAR(cell.simulation->mount_rotation_spread_rad, 0.5236, 1e-4);
  EXPECT_TRUE(cell.simulation->nominal_eMo.isFinite());
}

TEST_F(CellFile, TextLoadsAsAFile) {
  const CellConfig cell = load(test::oneCameraCell().text);
  EXPECT_EQ(cell.file, folder_ / "cell.yaml");
  EXPECT_EQ(cell.text, test::oneCameraCell().text);
  EXPECT_EQ(cell.arm.start_q, test::oneCameraCell().arm.start_q);
}

TEST_F(CellFile, MisspelledKeys) {
  EXPECT_EQ(refusal("max_speed_mps", "max_sped_mps"),
            at("max_speed_mps") + "unknown key 'max_sped_mps'; did you mean 'max_speed_mps'?");
  EXPECT_EQ(refusal("\ncoverage:", "\ncoverge:"),
            at("coverage:\n") + "unknown key 'coverge'; did you mean 'coverage'?");
  EXPECT_EQ(refusal("start_q_deg", "start_q_rad"),
            at("start_q_deg") + "unknown key 'start_q_rad'; did you mean 'start_q_deg'?");
  EXPECT_EQ(refusal("specular", "speculiar"),
            at("specular") + "unknown key 'speculiar'; did you mean 'specular'?");
}

TEST_F(CellFile, ValuesOutOfRange) {
  EXPECT_EQ(refusal("max_speed_mps: 0.25", "max_speed_mps: 250"),
            at("max_speed_mps") + "'max_speed_mps' is 250, allowed: 0.001 to 1");
  EXPECT_EQ(refusal("horizontal_fov_deg: 84", "horizontal_fov_deg: 0"),
            at("horizontal_fov_deg") + "'horizontal_fov_deg' is 0, allowed: 5 to 170");
  EXPECT_EQ(refusal("max_views: 40", "max_views: .nan"),
            at("max_views") + "'max_views' must be finite, not '.nan' (allowed: 3 to 1000)");
}

TEST_F(CellFile, StartPoseNamesEveryJoint) {
  EXPECT_EQ(refusal("start_q_deg: [", "start_q_deg: [0, "),
            at("start_q_deg") + "'start_q_deg' must be a list of 6 numbers, not a list of 7");
}

TEST_F(CellFile, BoxesAreNotInsideOut) {
  const std::string first = "    - name: camera\n      min_m: [";
  EXPECT_EQ(refusal(first, first + "90, 0, 0]\n      max_m: [1, 1, 1]\n    - name: b\n      min_m: ["),
            "cell.yaml:" + std::to_string(std::stoi(at("    - name: camera").substr(10)) + 1) +
                ": box 'camera': every number of 'min_m' must be below that of 'max_m'");
  const std::string workspace = "# where flange and board may be, in the robot base\n    min_m: [";
  expectPart(refusal(workspace, "\n    min_m: [99, 0, 0] #"), "box 'workspace': every number of 'min_m'");
}

TEST_F(CellFile, CamerasAreNamedOnceAndSimulatedOnce) {
  expectPart(refusal("cameras:\n  - name: cam1\n",
                     "cameras:\n  - {name: cam1, backend: sim, width_px: 640, "
                     "height_px: 480, horizontal_fov_deg: 60}\n  - name: cam1\n"),
             "camera 'cam1' is there twice; names must differ");
  EXPECT_EQ(refusal("    - name: cam1", "    - name: cam7"),
            at("    - name: cam1") + "the cell has no camera 'cam7'; it has: cam1");
  expectPart(refusal("cameras:\n  - name: cam1\n",
                     "cameras:\n  - {name: cam2, backend: sim, width_px: 640, "
                     "height_px: 480, horizontal_fov_deg: 60}\n  - name: cam1\n"),
             "camera 'cam2' has the backend 'sim' but is missing in 'simulation.cameras'");
  const std::string text = test::oneCameraCell().text;
  const std::size_t from = text.find("cameras:\n"), to = text.find("coverage:\n");
  expectPart(refusal(text.substr(from, to - from), "cameras: []\n"),
             "'cameras' must list at least one camera");
}

TEST_F(CellFile, SimulationIsDemandedBySimulatedBackends) {
  const std::string text = test::oneCameraCell().text;
  expectPart(refusal(text.substr(text.find("simulation:\n")), ""),
             "missing key 'simulation': the backend 'sim' needs it");
}

TEST_F(CellFile, ArmOfUniversalRobotsNamesHostAndSerial) {
  const CellConfig cell = load(changed("backend: sim\n  urdf", "backend: ur\n  host: 10.0.0.2\n"
                                       "  serial: \"0123\"\n  rtde_port: 5\n  urdf"));
  EXPECT_EQ(cell.arm.backend, ArmBackend::kUr);
  ASSERT_TRUE(cell.arm.ur.has_value());
  EXPECT_EQ(cell.arm.ur->host, "10.0.0.2");
  EXPECT_EQ(cell.arm.ur->serial, "0123");
  EXPECT_EQ(cell.arm.ur->rtde_port, 5);
  EXPECT_EQ(cell.arm.ur->program_port, 30001);
  EXPECT_FALSE(defaultCell().arm.ur.has_value());
  expectPart(refusal("backend: sim\n  urdf", "backend: ur\n  host: a\n  urdf"), "missing key 'serial' in 'arm'");
  expectPart(refusal("backend: sim\n  urdf", "backend: sim\n  host: a\n  urdf"), "unknown key 'host'");
}

TEST_F(CellFile, UrdfIsRelativeToTheCellFile) {
  EXPECT_EQ(load(changed("urdf: ur5 ", "urdf: robots/my.urdf ")).arm.urdf,
            (folder_ / "robots/my.urdf").string());
}

/// Words that look like keys ("word:" at the start of a line, a list item or a flow mapping).
std::set<std::string> keysOf(const CellConfig& cell) {
  std::set<std::string> keys;
  const std::string text = cell.text;
  const std::regex key("(?:^|\\n)[ -]*([A-Za-z_][A-Za-z0-9_]*):");
  for (std::sregex_iterator match(text.begin(), text.end(), key), end; match != end; ++match) {
    keys.insert((*match)[1]);
  }
  return keys;
}

/// What the other kinds of board need, as the library itself writes them.
std::set<std::string> keysOfEveryBoard() {
  std::set<std::string> keys;
  TagGrid aruco;
  aruco.family = "aruco_6x6_250";
  for (const BoardSpec& board :
       {BoardSpec{}, BoardSpec{aruco}, BoardSpec{Charuco{}}, BoardSpec{CircleGrid{}}}) {
    for (const auto& [key, value] : boardKeys(board)) keys.insert(key);
  }
  return keys;
}

TEST_F(CellFile, ReadsWhichDriverReadsACamera) {
  const auto camera = [&](const std::string& text) {
    return load(changed("- name: cam1\n    backend: sim", "- name: cam1\n    " + text)).cameras[0];
  };
  EXPECT_EQ(camera("backend: openni2").backend, CameraBackend::kOpenNi2);
  EXPECT_EQ(camera("backend: openni2").device, "");
  EXPECT_EQ(camera("backend: freenect\n    device: \"A0036\"").device, "A0036");
  EXPECT_EQ(camera("backend: v4l2\n    device: \"/dev/video2\"").backend, CameraBackend::kV4l2);
  expectPart(refusal("mount: fixed", "device: \"1\""), "unknown key 'device'");
  expectPart(refusal("backend: sim\n    mount: fixed",
                     "backend: v4l2\n    infrared: {width_px: 640, height_px: 480, horizontal_fov_deg: 60}"),
             "has a color image alone");
}

// No real camera sees what a simulated arm carries.
TEST_F(CellFile, RefusesARealCameraBeforeASimulatedArm) {
  const std::string second =
      "cameras:\n  - name: cam2\n    backend: openni2\n    width_px: 640\n    height_px: 480\n"
      "    horizontal_fov_deg: 60\n  - name: cam1\n    backend: sim\n    mount: fixed";
  const std::string message = refusal("cameras:\n  - name: cam1\n    backend: sim\n    mount: fixed", second);
  expectPart(message, "'cam2'");
  expectPart(message, "the arm is simulated");
}

TEST(CellConfig, SaysHowViewsAreChosen) {
  EXPECT_EQ(defaultCell().planner.choose_by, Planner::kCoverage);
  const PlannerConfig planner = loadCell(SERVOCAL_EVERY_KEY_CELL).planner;
  EXPECT_EQ(planner.choose_by, Planner::kInformation);
  EXPECT_EQ(planner.projection_goal_px, 0.35);
  EXPECT_EQ(planner.point_goal_m, 0.0005);
  EXPECT_EQ(planner.max_views, 150);
  EXPECT_EQ(planner.max_time_s, 600.0);
}

// The default cell, the cell of every key and the kinds of board name every key there is; the page must name the same, no more and no
// less.
TEST(CellPage, DocumentsEveryKeyAndNoOther) {
  std::ostringstream page;
  page << std::ifstream(SERVOCAL_CELL_PAGE).rdbuf();
  const std::string text = page.str();
  std::set<std::string> keys = keysOf(defaultCell());
  keys.merge(keysOf(test::oneCameraCell()));
  keys.merge(keysOf(loadCell(SERVOCAL_EVERY_KEY_CELL)));
  keys.merge(keysOfEveryBoard());
  for (const char* key : {"host", "serial", "rtde_port", "dashboard_port", "program_port"}) keys.insert(key);  // ur
  EXPECT_GT(keys.size(), 50u);
  for (const std::string& key : keys) {
    EXPECT_NE(text.find("`" + key + "`"), std::string::npos) << "docs/cell-file.md lacks `" << key << "`";
  }
  const std::regex row("\\n\\| `([A-Za-z0-9_]+)` \\|");
  for (std::sregex_iterator match(text.begin(), text.end(), row), end; match != end; ++match) {
    EXPECT_EQ(keys.count((*match)[1]), 1u)
        << "docs/cell-file.md has a key that does not exist: " << (*match)[1];
  }
}

}  // namespace
}  // namespace servocal
