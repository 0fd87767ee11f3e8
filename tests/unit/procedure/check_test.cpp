// SPDX-License-Identifier: GPL-3.0-or-later
// Does a stored calibration still hold? Cells with a known truth, calibrated once and then changed; no
// images.
#include "servocal/procedure/check.h"

#include <gtest/gtest.h>

#include <iostream>

#include "check_model.h"
#include "joint_scene.h"

namespace servocal::procedure {
namespace {

const test::Noise kNoise = {0.05, 0.0003, 0.0005};
constexpr double kDegree = M_PI / 180.0;

enum class Change { kNothing, kCamera, kIntrinsics, kMount };

Eigen::Vector3d direction(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

/// Two millimetres or 0.15 degrees, in any direction: the least that must be found.
Eigen::Isometry3d leastDisplacement(std::mt19937_64& random) {
  Eigen::Isometry3d by = Eigen::Isometry3d::Identity();
  const Eigen::Vector3d towards = direction(random);
  if (random() % 2 == 0) {
    by.translation() = 0.002 * towards;
  } else {
    by.linear() = Eigen::AngleAxisd(0.15 * kDegree, towards).toRotationMatrix();
  }
  return by;
}

std::vector<test::CellStop> checkStops(const test::Cell& cell, int per_camera) {
  std::vector<test::CellStop> stops;
  for (const test::CellCamera& camera : cell.cameras) {
    const auto views = checkViews(camera.model, 0.45);
    for (int i = 0; i < per_camera; ++i) {
      stops.push_back({Pose<Base, EndEffector>(camera.pose * views[static_cast<std::size_t>(i)].isometry() *
                                               cell.board_pose.inverse()),
                       {}});
    }
  }
  return stops;
}

/// A cell of `cameras` cameras, calibrated from 25 noisy views of each, then changed and looked at again.
struct Checked {
  test::Cell cell;       ///< As it is now.
  std::string changed;   ///< Camera that was moved or refocused.
  CalibrationResult stored;
  CheckVerdict verdict;
};

Checked checkAfter(Change change, std::uint64_t seed, int cameras) {
  std::mt19937_64 random(seed);
  test::Cell cell = test::makeCell(seed, cameras, Mount::kFixed, false);
  const auto calibration =
      test::observeAll(cell, test::randomStops(cell, 25 * cameras, random), kNoise, random);
  SolveOptions options;
  options.robot_sigma_m = kNoise.robot_m;
  options.robot_sigma_rad = kNoise.robot_rad;
  const CalibrationResult stored = solve(cell.board, calibration, options);
  const std::vector<test::CellStop> stops =
      checkStops(cell, checkViewsOfEach(cell.cameras.size()));  // Where they were known good.
  test::CellCamera& camera = cell.cameras[random() % cell.cameras.size()];
  if (change == Change::kCamera) {
    const Eigen::Isometry3d by = leastDisplacement(random);
    camera.pose.translation() += by.translation();
    camera.pose.linear() = by.linear() * camera.pose.linear();
  }
  if (change == Change::kIntrinsics) {
    camera.model.parameters.head<2>() *= 1.01;  // Refocused,
    camera.model.parameters[2] += 4.0;          // and the lens a little off.
  }
  if (change == Change::kMount) cell.board_pose = cell.board_pose * leastDisplacement(random);
  const auto views = test::observeAll(cell, stops, kNoise, random);
  CheckOptions check_options;
  check_options.robot_sigma_m = kNoise.robot_m;
  check_options.robot_sigma_rad = kNoise.robot_rad;
  return {cell, camera.name, stored, judgeCalibration(stored, views, check_options)};
}

struct Score {
  int cases = 0, found = 0, right = 0;
};

Score scoreOf(Change change, int cases, int cameras) {
  Score score;
  for (int i = 0; i < cases; ++i) {
    const Checked checked = checkAfter(change, 100 + static_cast<std::uint64_t>(i), cameras);
    const CheckVerdict& verdict = checked.verdict;
    ++score.cases;
    if (verdict.status != CheckStatus::kChanged) continue;
    ++score.found;
    const CheckPart wanted = change == Change::kCamera       ? CheckPart::kCamera
                             : change == Change::kIntrinsics ? CheckPart::kIntrinsics
                                                             : CheckPart::kMount;
    const CheckFinding& first = verdict.findings[0];
    score.right += first.part == wanted && (first.part == CheckPart::kMount || first.camera == checked.changed);
  }
  return score;
}

/// 800 cases in all, nightly; 24 of them every time.
TEST(Check, FindsWhatChangedAndOnlyThat) {
  constexpr int kCases = SERVOCAL_CHECK_CASES / 8;
  Score sound, camera, all;
  for (const int cameras : {1, 2}) {
    for (const Change change : {Change::kNothing, Change::kCamera, Change::kIntrinsics, Change::kMount}) {
      const Score score = scoreOf(change, kCases, cameras);
      std::cout << cameras << " cameras, change " << static_cast<int>(change) << ": " << score.cases
                << " cases, found " << score.found << ", right " << score.right << "\n";
      for (Score* sum : {change == Change::kNothing ? &sound : &all, change == Change::kCamera ? &camera : nullptr}) {
        if (sum == nullptr) continue;
        sum->cases += score.cases;
        sum->found += score.found;
        sum->right += score.right;
      }
    }
  }
  EXPECT_LE(sound.found, 0.02 * sound.cases);
  EXPECT_GE(camera.found, 0.95 * camera.cases);
  EXPECT_GE(all.right, 0.95 * all.cases);
}

// What the repair is for: afterwards the camera, or the board, is where it is.
TEST(Check, RepairPutsRightWhatMoved) {
  for (const Change change : {Change::kCamera, Change::kMount}) {
    const Checked checked = checkAfter(change, 5, 2);
    ASSERT_EQ(checked.verdict.status, CheckStatus::kChanged) << checked.verdict.sentence;
    ASSERT_EQ(checked.verdict.findings.size(), 1u) << checked.verdict.sentence;
    const Repaired now = repaired(checked.stored, checked.verdict);
    EXPECT_TRUE(now.whole);
    for (std::size_t i = 0; i < now.result.cameras.size(); ++i) {
      const CameraResult& camera = now.result.cameras[i];
      const CameraResult& before = checked.stored.cameras[i];
      const bool touched = change == Change::kMount || camera.camera == checked.changed;
      EXPECT_EQ(camera.notes.size(), before.notes.size() + (touched ? 1 : 0));
      EXPECT_EQ(camera.intrinsics.camera.parameters, before.intrinsics.camera.parameters);
      // The board as the repaired calibration puts it into the image, against the truth.
      const Eigen::Isometry3d bMe = checkStops(checked.cell, 1)[i].bMe.isometry();
      const Eigen::Isometry3d cMo = camera.hand_eye->camera_pose.inverse() * bMe * camera.hand_eye->board_pose;
      const Eigen::Isometry3d truth = checked.cell.cameras[i].pose.inverse() * bMe * checked.cell.board_pose;
      EXPECT_LT((cMo.translation() - truth.translation()).norm(), 0.001) << camera.camera;
    }
  }
}

TEST(Check, SaysSoIfTooLittleIsSeen) {
  const Checked sound = checkAfter(Change::kNothing, 5, 1);
  EXPECT_EQ(sound.verdict.status, CheckStatus::kOk) << sound.verdict.sentence;
  EXPECT_EQ(judgeCalibration(sound.stored, {}).status, CheckStatus::kNotSeen);
  std::mt19937_64 random(1);
  const auto two = test::observeAll(sound.cell, checkStops(sound.cell, 2), kNoise, random);
  EXPECT_EQ(judgeCalibration(sound.stored, two).status, CheckStatus::kTooFewViews);
}

TEST(ChiSquare, AgreesWithTables) {  // Abramowitz & Stegun, table 26.8
  EXPECT_NEAR(chiSquareTail(16.8119, 6), 0.01, 1e-6);
  EXPECT_NEAR(chiSquareTail(21.6660, 9), 0.01, 1e-6);
  EXPECT_NEAR(chiSquareTail(3.84146, 1), 0.05, 1e-6);
  EXPECT_EQ(chiSquareTail(0.0, 4), 1.0);
}

}  // namespace
}  // namespace servocal::procedure
