// SPDX-License-Identifier: GPL-3.0-or-later
// A disk that takes seconds for every write: the arm stands meanwhile, and the run is as good as any, only
// slower.
#include <gtest/gtest.h>

#include <chrono>
#include <iostream>

#include "servocal/procedure/calibrate.h"
#include "servocal/procedure/summary.h"
#include "servocal/session/check.h"
#include "servocal/sim/cell.h"
#include "sim_truth.h"
#include "spoiled_camera.h"
#include "sync_hook.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

constexpr double kStillMps = 0.001;  ///< And rad/s.
constexpr Duration kBraking = std::chrono::milliseconds(300);

CellConfig shortRun() {
  CellConfig cell = loadCell(SERVOCAL_CELLS "/ur_one_camera.yaml");
  cell.coverage.revisit_views = cell.coverage.check_views = 0;
  return cell;
}

/// Lets time pass and says whether the arm still moved 0.3 s after that began, or later.
bool movesWhile(sim::Cell& simulation, Duration passing) {
  simulation.clock().sleepFor(kBraking);
  const RobotState early = simulation.arm().state();
  simulation.clock().sleepFor(passing - kBraking);
  const RobotState late = simulation.arm().state();
  return early.twist.linear_mps.norm() > kStillMps || early.twist.angular_radps.norm() > kStillMps ||
         distanceM(early.bMe, late.bMe) > 1e-4;
}

struct Outcome {
  CalibrationResult result;
  double error_m = 0.0;  ///< Of the camera's place.
  int writes = 0;
  int moving_at_the_end_of_braking = 0;  ///< Writes in which movesWhile().
};

/// A run in which every write takes `write` of the run's time.
Outcome runWith(Duration write) {
  const CellConfig cell = shortRun();
  sim::Cell simulation(cell, 3);
  const robot::Kinematics kinematics(cell.arm);
  robot::Guard guard(simulation.arm(), kinematics, simulation.clock(), cell);
  const test::TemporaryFolder folder;
  Outcome outcome;
  {
    const test::SyncHook hook([&](int) {
      ++outcome.writes;
      if (write > kBraking) outcome.moving_at_the_end_of_braking += movesWhile(simulation, write);
    });
    session::Session session = session::Session::create(folder / "session", cell.text, cell.board, 3);
    outcome.result =
        procedure::calibrate(cell, {simulation.clock(), guard, {&simulation.camera("cam1")}}, session, {});
  }
  const session::SessionCheck check = session::checkSession(folder / "session");
  EXPECT_TRUE(check.whole());
  EXPECT_EQ(check.observations, outcome.result.observations);
  if (!outcome.result.cameras.empty() && outcome.result.cameras[0].hand_eye) {
    const Pose<Base, Color> bMc(outcome.result.cameras[0].hand_eye->camera_pose);
    outcome.error_m = distanceM(bMc, sim::Truth(simulation).bMc("cam1"));
  }
  return outcome;
}

TEST(SlowDisk, TheArmStandsWhileItWritesAndTheRunIsAsGoodOnlySlower) {
  const Outcome usual = runWith(Duration::zero()), slow = runWith(std::chrono::seconds(2));
  for (const Outcome* outcome : {&usual, &slow}) {
    std::cout << outcome->writes << " writes, " << outcome->result.motion_time_s << " s, camera off by "
              << 1e3 * outcome->error_m << " mm\n"
              << procedure::verdict(outcome->result) << "\n";
    ASSERT_EQ(outcome->result.cameras.size(), 1u);
    ASSERT_TRUE(outcome->result.cameras[0].hand_eye);
    EXPECT_LT(outcome->error_m, 0.002);
  }
  EXPECT_EQ(slow.result.goal_met, usual.result.goal_met);
  EXPECT_EQ(slow.moving_at_the_end_of_braking, 0);
  EXPECT_GT(slow.writes, 30);
  EXPECT_GT(slow.result.motion_time_s, usual.result.motion_time_s + slow.writes);
}

/// Half a second of the run is lost in each of ten images taken while the arm moves, as if something had been
/// written there; in how many of them movesWhile().
int movesWhenHeldUpInMotion(const robot::GuardOptions& options) {
  const CellConfig cell = shortRun();
  sim::Cell simulation(cell, 3);
  const robot::Kinematics kinematics(cell.arm);
  robot::Guard guard(simulation.arm(), kinematics, simulation.clock(), cell, options);
  const test::TemporaryFolder folder;
  session::Session session = session::Session::create(folder / "session", cell.text, cell.board, 3);
  struct Enough {};
  int held_up = 0, moving = 0;
  test::SpoiledCamera camera(simulation.camera("cam1"), [&](sensor::Frame&) {
    if (simulation.arm().state().twist.linear_mps.norm() < 0.02) return;
    moving += movesWhile(simulation, std::chrono::milliseconds(500));
    if (++held_up == 10) throw Enough{};
  });
  EXPECT_THROW((void)procedure::calibrate(cell, {simulation.clock(), guard, {&camera}}, session, {}), Enough);
  return moving;
}

TEST(SlowDisk, AnArmHeldUpInMotionBrakesByItself) { EXPECT_EQ(movesWhenHeldUpInMotion({}), 0); }

TEST(SlowDisk, WithoutTheTimeoutOfCommandsItWouldMoveOn) {
  robot::GuardOptions patient;
  patient.command_timeout = patient.look_ahead = std::chrono::seconds(1);
  patient.max_frame_age = std::chrono::seconds(1);
  EXPECT_GT(movesWhenHeldUpInMotion(patient), 0);
}

}  // namespace
}  // namespace servocal
