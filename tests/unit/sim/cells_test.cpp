// SPDX-License-Identifier: GPL-3.0-or-later
// The cell files for tests: they are read, their cameras see the board, and what they say about simulation
// arrives or is refused with its line.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>

#include "default_sim.h"
#include "reachable_cells.h"
#include "servocal/core/error.h"
#include "sim_truth.h"

namespace servocal::sim {
namespace {

const std::filesystem::path kCells = SERVOCAL_TEST_CELLS;

std::string textOf(const char* name) {
  std::ostringstream text;
  text << std::ifstream(kCells / name).rdbuf();
  return text.str();
}

/// What is said about a cell file in which `from` is replaced; empty if nothing.
std::string refusal(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
  try {
    parseCell(text, "cell.yaml");
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInvalidConfig);
    return error.what();
  }
  return "";
}

void expectPart(const std::string& whole, const std::string& part) {
  EXPECT_NE(whole.find(part), std::string::npos) << whole;
}

TEST(Cells, EveryCameraSeesTheBoardAtTheStart) {
  for (const char* name : {"one_camera.yaml", "panda.yaml", "eye_in_hand.yaml", "five_cameras.yaml"}) {
    const CellConfig config = loadCell(kCells / name);
    for (std::uint64_t seed = 1; seed <= 30; ++seed) {
      Cell cell(config, seed);
      const Truth truth(cell);
      for (const CameraConfig& camera : config.cameras) {
        for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
          if (stream == Stream::kInfrared && !camera.infrared) continue;
          const CameraModel model =
              stream == Stream::kColor ? truth.camera(camera.name) : truth.infrared(camera.name);
          for (const Eigen::Vector2d& pixel : truth.corners(camera.name, cell.clock().now(), stream)) {
            ASSERT_TRUE(model.contains(pixel, 20.0)) << name << " seed " << seed << " " << camera.name;
          }
        }
        const Pose<Color, Board> cMo = truth.cMo(camera.name, cell.clock().now());
        EXPECT_GT(cMo.translation().z(), 0.4) << name << " seed " << seed << " " << camera.name;
        EXPECT_GT(cMo.rotation()(2, 2), 0.3) << name << " seed " << seed << " " << camera.name;
      }
    }
  }
}

TEST(Cells, ThePapersCellCanBeFilled) {
  const CellConfig config = defaultCell();
  for (const CameraConfig& camera : config.cameras) {
    for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
      test::ReachSearch search;
      search.stream = stream;
      search.farthest_m = 1.1;
      // Time of flight measures from 0.5 m on.
      if (stream == Stream::kInfrared) search.nearest_m = 0.5;
      double least = 1.0;
      for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        Cell cell(config, seed);
        least = std::min(least, test::reachableCells(config, Truth(cell), camera.name, search).fraction());
      }
      EXPECT_GE(least, 0.85) << camera.name << " " << toString(stream);
    }
  }
}

TEST(Cells, V2CamerasStandAt45DegreesToTheSides) {
  const CellConfig config = defaultCell();
  for (const SimulatedCameraConfig& camera : config.simulation->cameras) {
    const Eigen::Vector3d towards = camera.look_at_m - camera.position_m;
    const double degrees = std::atan2(towards.y(), -towards.x()) * 180.0 / M_PI;
    const double wanted = camera.name == "left" ? -45.0 : camera.name == "right" ? 45.0 : 0.0;
    EXPECT_NEAR(degrees, wanted, 1.0) << camera.name;
  }
}

TEST(SimulationSection, InfraredDefaultsAreTheKinects) {
  const CellConfig config = defaultCell();
  const SimulatedInfraredConfig v2 = SimulatedInfraredConfig::like(*config.cameras[0].infrared);
  const SimulatedInfraredConfig v1 = SimulatedInfraredConfig::like(*config.cameras[2].infrared);
  EXPECT_NEAR(v2.focal_px, 366.0, 1.0);
  EXPECT_NEAR(v1.focal_px, 580.0, 1.0);
  EXPECT_EQ(v2.depth.nearest_m, 0.5);
  EXPECT_EQ(v1.depth.nearest_m, 0.4);
  // A step of the disparity at 1 m, as published: 2.85 mm.
  EXPECT_NEAR(v1.depth.disparity_step_px / (v1.focal_px * v1.depth.baseline_m), 0.00287, 0.00005);
}

TEST(SimulationSection, InfraredAndFaultsAreRead) {
  std::string text = defaultCell().text;
  text += R"(      infrared:
        black: 0.3
        depth:
          noise_m: 0.002
  faults:
    - {kind: inkjet_print}
    - {kind: depth_unit, camera: left, unit_m: 0.0001}
    - {kind: clock_offset, camera: right, offset_s: 0.08}
    - {kind: late_delivery, camera: right, offset_s: 0.05}
    - {kind: mount_slip, at_s: 60, translation_m: [0.003, 0, 0]}
    - {kind: camera_bump, camera: front, at_s: 90, rotation_vector_deg: [0, 2, 0]}
    - {kind: camera_turned_away, camera: left}
    - {kind: exposure, camera: left, at_s: 7, gain: 0.5, flicker: 0.25}
    - {kind: slow_frames, camera: right, rate_hz: 4}
)";
  const SimulationConfig simulation = parseCell(text, "cell.yaml").simulation.value();
  ASSERT_TRUE(simulation.cameras[2].infrared.has_value());
  EXPECT_EQ(simulation.cameras[2].infrared->black, 0.3);
  EXPECT_EQ(simulation.cameras[2].infrared->depth.noise_m, 0.002);
  EXPECT_EQ(simulation.cameras[2].infrared->depth.nearest_m, 0.4);  // Still a v1's.
  ASSERT_EQ(simulation.faults.size(), 9u);
  EXPECT_EQ(simulation.faults[1].camera, "left");
  EXPECT_EQ(simulation.faults[1].unit_m, 0.0001);
  EXPECT_EQ(simulation.faults[2].kind, FaultKind::kClockOffset);
  EXPECT_EQ(simulation.faults[3].offset_s, 0.05);
  EXPECT_EQ(simulation.faults[4].at_s, 60.0);
  EXPECT_EQ(simulation.faults[4].translation_m.x(), 0.003);
  EXPECT_NEAR(simulation.faults[5].rotation_rad.y(), 2.0 * M_PI / 180.0, 1e-12);
  EXPECT_EQ(simulation.faults[7].at_s, 7.0);
  EXPECT_EQ(simulation.faults[7].gain, 0.5);
  EXPECT_EQ(simulation.faults[7].flicker, 0.25);
  EXPECT_EQ(simulation.faults[8].rate_hz, 4.0);
  for (std::size_t i = 0; i < 9; ++i) {  // Names and enumerators go together.
    EXPECT_EQ(static_cast<std::size_t>(simulation.faults[i].kind), i);
  }
}

TEST(SimulationSection, MistakesAreRefused) {
  const std::string paper = defaultCell().text;
  const auto faultSaid = [&](const std::string& fault) {
    return refusal(paper, "  cameras:\n    - name: left\n      position_m",
                   "  faults:\n    - " + fault + "\n  cameras:\n    - name: left\n      position_m");
  };
  expectPart(faultSaid("{kind: mount_slips, at_s: 1}"), "mount_slip");
  expectPart(faultSaid("{kind: clock_offset, camera: top, offset_s: 1}"), "the cell has no camera 'top'");
  expectPart(faultSaid("{kind: mount_slip, at_s: 1}"), "'translation_m' or 'rotation_vector_deg'");
  expectPart(faultSaid("{kind: inkjet_print, camera: left}"), "unknown key 'camera'");
  expectPart(faultSaid("{kind: late_delivery, camera: left, offset_s: -1}"), "allowed: 0 to 10");
  expectPart(faultSaid("{kind: exposure, camera: left}"), "needs a 'gain' other than 1, or 'flicker'");
  const std::string one = textOf("one_camera.yaml");
  expectPart(refusal(one, "      focal_px: 1066", "      infrared: {black: 0.2}\n      focal_px: 1066"),
             "unknown key 'infrared'");  // The camera has none.
  expectPart(refusal(one, "  cameras:\n    - name: cam1\n      pos",
                     "  faults:\n    - {kind: depth_unit, camera: cam1, unit_m: 0.0001}\n  cameras:\n    - "
                     "name: cam1\n      pos"),
             "camera 'cam1' has no depth");
}

}  // namespace
}  // namespace servocal::sim
