// SPDX-License-Identifier: GPL-3.0-or-later
// What a stop makes of a cell in which something is wrong just then: nothing, or an observation that is
// right.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <utility>

#include "cells.h"
#include "run.h"
#include "servocal/sim/cell.h"
#include "sim_truth.h"
#include "temporary_folder.h"

namespace servocal::procedure {
namespace {

constexpr double kFrameS = 1.0 / 30.0, kBetweenExposuresS = 0.0267;

/// An arm that creeps, as one with a brake that slips, and says that it stands.
class CreepingArm final : public robot::Arm {
 public:
  explicit CreepingArm(robot::Arm& arm) : arm_(arm) {}
  const robot::ArmInfo& info() const override { return arm_.info(); }
  RobotState state() override { return crept(arm_.state()); }
  RobotState stateAt(Instant stamp) override { return crept(arm_.stateAt(stamp)); }
  void move(robot::MotionKey key, const Twist<Base>& twist, Duration valid_for) override {
    arm_.move(key, twist, valid_for);
  }
  void moveJoints(robot::MotionKey key, const Eigen::VectorXd& speeds_radps, Duration valid_for) override {
    arm_.moveJoints(key, speeds_radps, valid_for);
  }
  void stop(robot::MotionKey key) override { arm_.stop(key); }
  double speed_mps = 0.0;

 private:
  RobotState crept(RobotState state) const {
    state.bMe = Pose<Base, EndEffector>(
        Eigen::Matrix3d(state.bMe.rotation()),
        state.bMe.translation() + speed_mps * toSeconds(state.stamp) * Eigen::Vector3d::UnitZ());
    return state;
  }
  robot::Arm& arm_;
};

/// A cell with one camera, at its start pose, where the camera sees the board.
struct Stand {
  explicit Stand(const CellConfig& its_cell = test::oneCameraCell()) : cell(its_cell) {}

  Eye& eye() { return run.eyes().front(); }
  std::optional<Observation> observe() { return run.observe("cover", eye()); }

  CellConfig cell;
  sim::Cell simulation{cell, 3};
  CreepingArm arm{simulation.arm()};
  robot::Kinematics kinematics{cell.arm};
  robot::Guard guard{arm, kinematics, simulation.clock(), cell};
  test::TemporaryFolder folder;
  session::Session session = session::Session::create(folder.path() / "session", cell.text, cell.board, 3);
  const EventSink on_event{};
  const LookSink on_look{};
  const CalibrateOptions options{};
  Run run{cell,    Devices{simulation.clock(), guard, {&simulation.camera(cell.cameras[0].name)}},
          session, on_event,
          options, on_look};
};

CellConfig exposedCell(double gain, double flicker) {
  CellConfig cell = test::oneCameraCell();
  SimulationFault exposure;
  exposure.kind = FaultKind::kExposure;
  exposure.camera = cell.cameras[0].name;
  exposure.gain = gain;
  exposure.flicker = flicker;
  cell.simulation->faults.push_back(exposure);
  return cell;
}

/// The board jumps to and fro on its mount between any two exposures of the first second.
CellConfig swayingCell() {
  CellConfig cell = test::oneCameraCell();
  for (int i = 0; i < 30; ++i) {
    SimulationFault slip;
    slip.kind = FaultKind::kMountSlip;
    slip.at_s = kBetweenExposuresS + i * kFrameS;
    slip.translation_m.x() = i % 2 == 0 ? 0.002 : -0.002;
    cell.simulation->faults.push_back(slip);
  }
  return cell;
}

TEST(Stop, OfASoundCellIsAnObservation) {
  Stand stand;
  ASSERT_TRUE(stand.observe());
  EXPECT_EQ(stand.session.observations().size(), 1u);
}

TEST(Stop, ABoardThatStillSwaysIsNotObservedUntilItStands) {
  Stand stand(swayingCell());
  EXPECT_FALSE(stand.observe());
  EXPECT_TRUE(stand.session.observations().empty());
  stand.simulation.clock().sleepUntil(Instant(std::chrono::milliseconds(1100)));
  EXPECT_TRUE(stand.observe());
}

TEST(Stop, AnArmThatCreepsIsNotObserved) {
  Stand stand;
  stand.arm.speed_mps = 0.02;
  EXPECT_FALSE(stand.observe());
  EXPECT_TRUE(stand.session.observations().empty());
  stand.arm.speed_mps = 0.0;
  EXPECT_TRUE(stand.observe());
}

TEST(Stop, AFlickeringExposureMovesNoCorner) {
  const auto rmsPx = [](Stand& stand, const Observation& observation) {
    const sim::Truth truth(stand.simulation);
    const auto corners = truth.corners(stand.cell.cameras[0].name, observation.views[0].stamp);
    double squares_px2 = 0.0;
    for (const Corner& corner : observation.views[0].detection.corners) {
      squares_px2 += (corner.pixel - corners[static_cast<std::size_t>(corner.id)]).squaredNorm();
    }
    return std::sqrt(squares_px2 / static_cast<double>(observation.views[0].detection.corners.size()));
  };
  Stand sound, flickering(exposedCell(0.92, 0.62));  // 0.35 to 1.5
  const auto right = sound.observe(), spoiled = flickering.observe();
  ASSERT_TRUE(right && spoiled);
  ASSERT_EQ(spoiled->views[0].detection.corners.size(), right->views[0].detection.corners.size());
  const double right_px = rmsPx(sound, *right), spoiled_px = rmsPx(flickering, *spoiled);
  std::cout << "corners off by " << right_px << " px, with flicker " << spoiled_px << " px\n";
  EXPECT_LT(spoiled_px, right_px + 0.05);
}

// Of half black, half white print, where black reads a millimetre farther.
TEST(Stop, DepthOfTimeOfFlightIsThatOfTheWhite) {
  CellConfig cell = defaultCell();
  cell.cameras.erase(cell.cameras.begin() + 1, cell.cameras.end());
  Stand stand(cell);
  const auto observation = stand.observe();
  ASSERT_TRUE(observation);
  const auto seen = std::find_if(observation->views.begin(), observation->views.end(),
                                 [](const StreamObservation& view) { return view.depth.has_value(); });
  ASSERT_NE(seen, observation->views.end());
  const sim::Truth truth(stand.simulation);
  const Pose<Infrared, Board> iMo = truth.cMi(seen->camera).inverse() * truth.cMo(seen->camera, seen->stamp);
  const Eigen::Vector3d normal = iMo.rotation().col(2);
  double off_m = 0.0;
  for (const DepthPatch& patch : seen->depth->patches) {
    const Eigen::Vector3d ray = truth.infrared(seen->camera).unproject(patch.pixel)->homogeneous();
    const double plane_m = normal.dot(iMo.translation()) / normal.dot(ray);
    off_m += (patch.depth_m - truth.measuredDepth(seen->camera, patch.pixel, plane_m)) /
             static_cast<double>(seen->depth->patches.size());
  }
  EXPECT_NEAR(off_m, 0.0, 2e-4);  // With the print: 0.5 mm.
}

TEST(Stop, DarknessAndGlareAreNamed) {
  for (const auto& [gain, part] : {std::pair{0.05, "almost black"}, std::pair{8.0, "saturated"}}) {
    Stand stand(exposedCell(gain, 0.0));
    EXPECT_FALSE(stand.observe());
    const auto problem = bootstrap(stand.run, stand.eye());
    ASSERT_TRUE(problem);
    EXPECT_NE(problem->find(part), std::string::npos) << *problem;
    EXPECT_TRUE(stand.session.observations().empty());
    EXPECT_FALSE(stand.guard.motionSpan());
  }
}

}  // namespace
}  // namespace servocal::procedure
