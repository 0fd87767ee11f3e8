// SPDX-License-Identifier: GPL-3.0-or-later
// Solvers that do not arrive: every step that they take is cut to a hundredth of its length (the linker puts
// `cutStep` in arrowStep's place). They say so and hand out nothing.
#include <gtest/gtest.h>

#include "arrow.h"
#include "errors.h"
#include "joint_scene.h"
#include "servocal/calib/camera_pair.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/calib/joint.h"
#include "servocal/calib/reprojection.h"
#include "servocal/procedure/solve.h"

namespace servocal {
namespace {

double share_of_step = 1.0;

}  // namespace

std::optional<calib::ArrowStep> wholeStep(const calib::ArrowSystem& system,
                                          double damping) asm("__real_" SERVOCAL_ARROW_STEP);
std::optional<calib::ArrowStep> cutStep(const calib::ArrowSystem& system,
                                        double damping) asm("__wrap_" SERVOCAL_ARROW_STEP);

std::optional<calib::ArrowStep> cutStep(const calib::ArrowSystem& system, double damping) {
  auto step = wholeStep(system, damping);
  if (!step) return step;
  step->shared *= share_of_step;
  for (calib::Vector6d& block : step->blocks) block *= share_of_step;
  return step;
}

namespace {

/// Two cameras with 15 noisy views of each; most are seen by both.
class NoConvergence : public ::testing::Test {
 protected:
  NoConvergence() {
    std::mt19937_64 random(3);
    cell = test::makeCell(3, 2, Mount::kFixed, false);
    cell.cameras[1].pose =
        cell.cameras[0].pose * Pose<Color, Color>::fromRotationVector({0, 0.1, 0}, {-0.08, 0, 0}).isometry();
    observations = test::observeAll(cell, test::randomStops(cell, 30, random), {0.1, 1e-4, 2.5e-4}, random);
  }
  ~NoConvergence() override { share_of_step = 1.0; }

  calib::IntrinsicsOutcome intrinsics() const {
    return calib::solveIntrinsics(cell.board, observations, "k1", Stream::kColor);
  }
  calib::HandEyeOutcome handEye() const {
    return calib::solveHandEyeReprojection(cell.board, cell.cameras[0].model, observations, "k1",
                                           Stream::kColor);
  }
  calib::PairOutcome pair() const {
    return calib::solveCameraPair(cell.board, {"k1", Stream::kColor, cell.cameras[0].model},
                                  {"k2", Stream::kColor, cell.cameras[1].model}, observations);
  }

  test::Cell cell;
  std::vector<Observation> observations;
};

TEST_F(NoConvergence, IsSaidByEverySolver) {
  EXPECT_TRUE(intrinsics().result);
  EXPECT_TRUE(handEye().solution);
  EXPECT_TRUE(pair().solution);
  EXPECT_TRUE(calib::solveJoint(cell.board, observations).solution);
  share_of_step = 0.01;
  const auto no_intrinsics = intrinsics();
  EXPECT_EQ(no_intrinsics.status, calib::IntrinsicsStatus::kNotConverged);
  EXPECT_FALSE(no_intrinsics.result);
  const auto no_hand_eye = handEye();
  EXPECT_EQ(no_hand_eye.status, calib::HandEyeStatus::kNotConverged);
  EXPECT_FALSE(no_hand_eye.solution);
  const auto no_pair = pair();
  EXPECT_EQ(no_pair.status, calib::PairStatus::kNotConverged);
  EXPECT_FALSE(no_pair.solution);
  EXPECT_FALSE(calib::solveJoint(cell.board, observations).solution);  // It has no intrinsics to begin with.
}

TEST_F(NoConvergence, IsMissingInTheResult) {
  share_of_step = 0.01;
  const CalibrationResult nothing = procedure::solve(cell.board, observations);
  EXPECT_TRUE(nothing.cameras.empty());
  EXPECT_FALSE(nothing.goal_met);
  ASSERT_EQ(nothing.missing.size(), 2u);
  test::expectPart(nothing.missing[0], "intrinsics of k1: The solve did not converge");
  procedure::SolveOptions options;
  for (const test::CellCamera& camera : cell.cameras) {
    options.given_intrinsics[{camera.name, camera.stream}] = camera.model;
  }
  const CalibrationResult intrinsics_alone = procedure::solve(cell.board, observations, options);
  ASSERT_EQ(intrinsics_alone.cameras.size(), 2u);
  EXPECT_FALSE(intrinsics_alone.cameras[0].hand_eye);
  EXPECT_FALSE(intrinsics_alone.goal_met);
  EXPECT_TRUE(intrinsics_alone.camera_pairs.empty());
  EXPECT_FALSE(intrinsics_alone.joint);
  ASSERT_EQ(intrinsics_alone.missing.size(), 3u);
  test::expectPart(intrinsics_alone.missing[0], "hand-eye of k1: The solve did not converge");
  test::expectPart(intrinsics_alone.missing[2], "pose of k2 in k1: the solve did not converge");
  test::expectPart(intrinsics_alone.joint_problem, "did not converge");
}

}  // namespace
}  // namespace servocal
