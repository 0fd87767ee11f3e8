// SPDX-License-Identifier: GPL-3.0-or-later
// Does a stored calibration still hold? Cells with a known truth, calibrated once and then changed; no
// images.
#include "servocal/procedure/check.h"

#include <gtest/gtest.h>

#include <array>
#include <iostream>

#include "check_model.h"
#include "joint_scene.h"
#include "stream_solver.h"

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

/// A cell of `cameras` cameras, calibrated from 25 noisy views of each.
struct Calibrated {
  test::Cell cell;
  CalibrationResult stored;
  std::mt19937_64 random;  ///< For what happens later.
};

Calibrated calibrated(std::uint64_t seed, int cameras) {
  std::mt19937_64 random(seed);
  const test::Cell cell = test::makeCell(seed, cameras, Mount::kFixed, false);
  const auto views = test::observeAll(cell, test::randomStops(cell, 25 * cameras, random), kNoise, random);
  SolveOptions options;
  options.robot_sigma_m = kNoise.robot_m;
  options.robot_sigma_rad = kNoise.robot_rad;
  CalibrationResult stored;  // As solve() makes it, without the joint estimate, which takes longest.
  stored.board = cell.board;
  for (const test::CellCamera& camera : cell.cameras) {
    stored.cameras.push_back(
        StreamSolver(cell.board, views, camera.name, Stream::kColor, options).solve(true).value());
  }
  return {cell, stored, random};
}

/// Then changed and looked at again.
struct Checked {
  test::Cell cell;      ///< As it is now.
  std::string changed;  ///< Camera that was moved or refocused.
  CalibrationResult stored;
  CheckVerdict verdict;
};

Checked checkAfter(Change change, const Calibrated& before) {
  std::mt19937_64 random = before.random;
  test::Cell cell = before.cell;
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
  return {cell, camera.name, before.stored, judgeCalibration(before.stored, views, check_options)};
}

struct Score {
  int cases = 0, found = 0, right = 0;
  void add(const Score& other) {
    cases += other.cases;
    found += other.found;
    right += other.right;
  }
};

Score scoreOf(Change change, const Checked& checked) {
  const CheckVerdict& verdict = checked.verdict;
  if (verdict.status != CheckStatus::kChanged) return {1, 0, 0};
  const CheckPart wanted = change == Change::kCamera       ? CheckPart::kCamera
                           : change == Change::kIntrinsics ? CheckPart::kIntrinsics
                                                           : CheckPart::kMount;
  const CheckFinding& first = verdict.findings[0];
  const bool right =
      first.part == wanted && (first.part == CheckPart::kMount || first.camera == checked.changed);
  return {1, 1, right ? 1 : 0};
}

/// By change.
std::array<Score, 4> scores(int cases, int cameras) {
  std::array<Score, 4> scores;
  for (int i = 0; i < cases; ++i) {
    const Calibrated before = calibrated(100 + static_cast<std::uint64_t>(i), cameras);
    for (std::size_t change = 0; change < scores.size(); ++change) {
      const auto kind = static_cast<Change>(change);
      scores[change].add(scoreOf(kind, checkAfter(kind, before)));
    }
  }
  for (std::size_t change = 0; change < scores.size(); ++change) {
    std::cout << cameras << " cameras, change " << change << ": " << scores[change].cases << " cases, found "
              << scores[change].found << ", right " << scores[change].right << std::endl;
  }
  return scores;
}

void expectPower(const std::array<Score, 4>& scores) {
  EXPECT_LE(scores[0].found, 0.02 * scores[0].cases);
  EXPECT_GE(scores[1].found, 0.95 * scores[1].cases);
  EXPECT_GE(scores[1].right, 0.95 * scores[1].cases);
  Score all;
  for (std::size_t change = 1; change < scores.size(); ++change) all.add(scores[change]);
  EXPECT_GE(all.right, 0.95 * all.cases);
}

// 200 cases of each kind nightly, 6 every time.
TEST(Check, FindsWhatChangedInCellsOfOneAndTwoCamerasAndOnlyThat) {
  std::array<Score, 4> sum = scores(SERVOCAL_CHECK_CASES / 2, 1);
  const std::array<Score, 4> two = scores(SERVOCAL_CHECK_CASES / 2, 2);
  for (std::size_t change = 0; change < sum.size(); ++change) sum[change].add(two[change]);
  expectPower(sum);
}

TEST(Check, FindsWhatChangedInCellsOfThreeCamerasAndOnlyThat) {
  expectPower(scores(SERVOCAL_CHECK_CASES, 3));
}

// What the repair is for: afterwards the camera, or the board, is where it is.
TEST(Check, RepairPutsRightWhatMoved) {
  for (const Change change : {Change::kCamera, Change::kMount}) {
    const Checked checked = checkAfter(change, calibrated(5, 2));
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
      const Eigen::Isometry3d cMo =
          camera.hand_eye->camera_pose.inverse() * bMe * camera.hand_eye->board_pose;
      const Eigen::Isometry3d truth = checked.cell.cameras[i].pose.inverse() * bMe * checked.cell.board_pose;
      EXPECT_LT((cMo.translation() - truth.translation()).norm(), 0.001) << camera.camera;
    }
  }
}

TEST(Check, SaysSoIfTooLittleIsSeen) {
  const Checked sound = checkAfter(Change::kNothing, calibrated(5, 1));
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
