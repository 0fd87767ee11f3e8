// SPDX-License-Identifier: GPL-3.0-or-later
// What goes wrong in a cell ends well: the rest is calibrated, and the result names the trouble.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <opencv2/imgproc.hpp>

#include "default_sim.h"
#include "errors.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/procedure/summary.h"
#include "servocal/sim/cell.h"
#include "spoiled_camera.h"
#include "temporary_folder.h"
#include "trial.h"

namespace servocal {
namespace {

/// A whole Kinect v2 before the arm, and so few views that a run is short; its coverage is not complete then.
CellConfig shortRun() {
  CellConfig cell = test::kinectSimCell(DepthSensor::kTimeOfFlight);
  cell.coverage.near_distance_m = 0.55;
  cell.coverage.max_views = 6;
  cell.coverage.revisit_views = cell.coverage.check_views = 0;
  return cell;
}

bool names(const CalibrationResult& result, const std::string& part) {
  return std::any_of(result.missing.begin(), result.missing.end(),
                     [&](const std::string& sentence) { return sentence.find(part) != std::string::npos; });
}

CalibrationResult run(const CellConfig& cell) {
  const test::TemporaryFolder folder;
  return test::runTrial(cell, 3, folder.path() / "session").result;
}

// What the tests below look for is not there when nothing is wrong.
TEST(Faults, NothingIsNamedInASoundCell) {
  const CalibrationResult result = run(shortRun());
  ASSERT_EQ(result.cameras.size(), 1u);
  EXPECT_TRUE(result.cameras[0].infrared && result.cameras[0].color_infrared && result.cameras[0].depth);
  EXPECT_FALSE(names(result, "Ink-jet"));
  EXPECT_FALSE(names(result, "depth of"));
}

TEST(Faults, APrintWithoutContrastInInfrared) {
  CellConfig cell = shortRun();
  cell.simulation->faults.emplace_back().kind = FaultKind::kInkjetPrint;
  const CalibrationResult result = run(cell);
  ASSERT_EQ(result.cameras.size(), 1u);
  EXPECT_TRUE(result.cameras[0].hand_eye);  // Color is calibrated all the same.
  EXPECT_FALSE(result.cameras[0].infrared);
  EXPECT_TRUE(names(result, "Ink-jet"));
  EXPECT_FALSE(result.goal_met);
}

TEST(Faults, DepthInAnotherUnit) {
  CellConfig cell = shortRun();
  SimulationFault fault;
  fault.kind = FaultKind::kDepthUnit;
  fault.camera = cell.cameras[0].name;
  fault.unit_m = 1e-4;
  cell.simulation->faults.push_back(fault);
  const CalibrationResult result = run(cell);
  ASSERT_EQ(result.cameras.size(), 1u);
  EXPECT_TRUE(result.cameras[0].infrared);
  EXPECT_FALSE(result.cameras[0].depth);
  EXPECT_TRUE(names(result, "depth of " + fault.camera));
  EXPECT_TRUE(names(result, "one count is probably 1e-04 m"));
}

/// A second camera of the same kind, `shift_m` from the first.
CellConfig twoCameras(const std::string& name, const Eigen::Vector3d& shift_m) {
  CellConfig cell = shortRun();
  cell.cameras.push_back(cell.cameras[0]);
  cell.cameras.back().name = name;
  SimulatedCameraConfig simulated = cell.simulation->cameras[0];
  simulated.name = name;
  simulated.position_m += shift_m;
  cell.simulation->cameras.push_back(simulated);
  return cell;
}

TEST(Faults, AMountThatSlips) {
  CellConfig cell = twoCameras("beside", {0.0, 0.12, 0.05});
  EXPECT_FALSE(names(run(cell), "the board on the flange moved"));
  SimulationFault fault;
  fault.kind = FaultKind::kMountSlip;
  fault.at_s = 55.0;
  fault.translation_m = {0.0, 0.003, 0.0};
  cell.simulation->faults.push_back(fault);
  EXPECT_TRUE(names(run(cell), "the board on the flange moved"));
}

TEST(Faults, ACameraThatNeverSeesTheBoard) {
  CellConfig cell = twoCameras("lost", Eigen::Vector3d::Zero());
  SimulationFault fault;
  fault.kind = FaultKind::kCameraTurnedAway;
  fault.camera = "lost";
  cell.simulation->faults.push_back(fault);
  const CalibrationResult result = run(cell);
  ASSERT_EQ(result.cameras.size(), 1u);
  EXPECT_EQ(result.cameras[0].camera, cell.cameras[0].name);
  EXPECT_TRUE(result.cameras[0].hand_eye);
  EXPECT_TRUE(names(result, "lost: it never saw the board"));
}

/// A run whose cameras somebody stands before.
struct SpoiledRun {
  explicit SpoiledRun(const CellConfig& its_cell) : cell(its_cell) {}

  CalibrationResult run(const std::vector<sensor::RgbdCamera*>& cameras) {
    session::Session session = session::Session::create(folder.path() / "session", cell.text, cell.board, 3);
    return procedure::calibrate(cell, {simulation.clock(), guard, cameras}, session, {});
  }

  CellConfig cell;
  sim::Cell simulation{cell, 3};
  robot::Kinematics kinematics{cell.arm};
  robot::Guard guard{simulation.arm(), kinematics, simulation.clock(), cell};
  test::TemporaryFolder folder;
};

TEST(Faults, AResolutionThatChangesEndsTheRunAndKeepsWhatWasSeen) {
  SpoiledRun run(shortRun());
  test::SpoiledCamera camera(run.simulation.camera("front"), [&](sensor::Frame& frame) {
    if (frame.stream == Stream::kColor && run.simulation.clock().now() > Instant(std::chrono::seconds(25))) {
      cv::resize(frame.image, frame.image, {}, 0.5, 0.5);
    }
  });
  const std::string message = test::messageOf(ErrorKind::kHardwareAbsent, [&] { (void)run.run({&camera}); });
  test::expectPart(message, "960 x 540 px in place of 1920 x 1080");
  test::expectPart(message, "'front'");
  run.simulation.clock().sleepFor(std::chrono::milliseconds(300));
  const Twist<Base> twist = run.guard.state().twist;
  EXPECT_TRUE(twist.isZero()) << twist.linear_mps.norm() << " m/s, " << twist.angular_radps.norm() << " rad/s";
  const auto session = session::Session::open(run.folder.path() / "session");
  EXPECT_GE(session.observations().size(), 5u);
  EXPECT_EQ(session.events().back().kind, "fault");
  EXPECT_EQ(session.events().back().message, message);
}

// Something stands before a sixth of the image: the arm reaches the cells there, the board is not seen in
// them.
TEST(Faults, ImageCellsWhereTheBoardIsLostAreMissingAndNotOutOfReach) {
  CellConfig cell = loadCell(SERVOCAL_CELLS "/ur_one_camera.yaml");
  cell.coverage.cells_x = 6;
  cell.coverage.cells_y = 1;
  cell.coverage.revisit_views = cell.coverage.check_views = 0;
  cell.coverage.max_views = 30;
  SpoiledRun run(cell);
  test::SpoiledCamera camera(run.simulation.camera("cam1"), [](sensor::Frame& frame) {
    frame.image.colRange(frame.image.cols * 5 / 6, frame.image.cols).setTo(90);
  });
  const CalibrationResult result = run.run({&camera});
  SCOPED_TRACE(procedure::verdict(result));
  ASSERT_EQ(result.cameras.size(), 1u);
  ASSERT_TRUE(result.cameras[0].coverage);
  EXPECT_FALSE(result.goal_met);
  EXPECT_TRUE(names(
      result, "1 of 6 image cells are not filled, 1 given up because the board was lost or not found there"));
  EXPECT_EQ(result.cameras[0].coverage->unreachable, std::vector<bool>(6, false));
}

// One camera delivers four images per second and another stares into the dark: the third is served as ever,
// and both are named.
TEST(Faults, SlowAndDarkCamerasAreNamedAndDoNotHoldUpTheOthers) {
  CellConfig cell = twoCameras("slow", {0.0, 0.12, 0.05});
  cell.cameras.push_back(cell.cameras[0]);
  cell.cameras.back().name = "dark";
  cell.simulation->cameras.push_back(cell.simulation->cameras[0]);
  cell.simulation->cameras.back().name = "dark";
  for (CameraConfig& camera : cell.cameras) camera.infrared.reset();
  SimulationFault slow, dark;
  slow.kind = FaultKind::kSlowFrames;
  slow.camera = "slow";
  slow.rate_hz = 4.0;
  dark.kind = FaultKind::kExposure;
  dark.camera = "dark";
  dark.gain = 0.04;
  cell.simulation->faults = {slow, dark};
  const CalibrationResult result = run(cell);
  ASSERT_GE(result.cameras.size(), 1u);
  EXPECT_EQ(result.cameras[0].camera, "front");
  EXPECT_TRUE(result.cameras[0].hand_eye);
  EXPECT_TRUE(names(result, "dark: it never saw the board (its image is almost black"));
  bool slow_is_named = names(result, "images per second came in place of 30");
  for (const CameraResult& camera : result.cameras) {
    for (const std::string& note : camera.notes) {
      slow_is_named =
          slow_is_named || (camera.camera == "slow" &&
                            note.find("images per second came in place of 30") != std::string::npos);
    }
  }
  EXPECT_TRUE(slow_is_named);
}

}  // namespace
}  // namespace servocal
