// SPDX-License-Identifier: GPL-3.0-or-later
// What goes wrong in a cell ends well: the rest is calibrated, and the result names the trouble.
#include <gtest/gtest.h>

#include <algorithm>

#include "default_sim.h"
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

}  // namespace
}  // namespace servocal
