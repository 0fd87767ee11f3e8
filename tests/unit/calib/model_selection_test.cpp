// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/model_selection.h"

#include <gtest/gtest.h>

#include <iostream>

#include "joint_scene.h"

namespace servocal::calib {
namespace {

/// A flat board and a lens without k3; then a bowed one; then with k3.
std::vector<ModelCandidate> candidates() {
  ModelCandidate lean{"flat board, lens to k2", {}};
  lean.options.board.bow = false;
  lean.options.streams.emplace_back();
  lean.options.streams.back().camera = "k1";
  lean.options.streams.back().fixed = {"k3"};
  ModelCandidate bowed = lean;
  bowed.name = "bowed board";
  bowed.options.board.bow = true;
  ModelCandidate both = bowed;
  both.name = "k3";
  both.options.streams.back().fixed.clear();
  return {lean, bowed, both};
}

ModelSelection select(double bow_m, double k3) {
  test::Cell cell = test::makeCell(8, 1, Mount::kFixed, false);
  cell.shape.bow_x_m = bow_m;
  cell.cameras[0].model.parameters[8] = k3;
  std::mt19937_64 random(3);
  const auto stops = test::randomStops(cell, 60, random);
  const auto observations = test::observeAll(cell, stops, {0.2, 1e-4, 2.5e-4}, random);
  const auto selection = selectModel(cell.board, observations, candidates());
  EXPECT_TRUE(selection.has_value());
  if (!selection) return {};
  for (const ModelScore& score : selection->scores) {
    std::cout << "bow " << 1e3 * bow_m << " mm, k3 " << k3 << ": " << score.name << ", gain " << score.gain
              << " +- " << score.gain_sigma << ", held out " << score.rms_px << " px, z " << score.z
              << (score.kept ? ", kept\n" : "\n");
  }
  std::cout << selection->sentence << '\n';
  return *selection;
}

TEST(SelectModel, KeepsWhatTheDataSupportAndNothingElse) {
  EXPECT_EQ(select(0.0, 0.0).chosen, 0u);
  const ModelSelection bowed = select(6e-4, 0.0);
  EXPECT_EQ(bowed.chosen, 1u);
  EXPECT_FALSE(bowed.scores[2].kept);
  const ModelSelection lens = select(0.0, 0.35);
  EXPECT_EQ(lens.chosen, 2u);
  EXPECT_FALSE(lens.scores[1].kept);
  EXPECT_GT(lens.scores[0].rms_px, lens.scores[2].rms_px);
}

TEST(SelectModel, ThrowsOnACallersMistakes) {
  EXPECT_THROW((void)selectModel(BoardSpec{}, {}, {}), std::invalid_argument);
  EXPECT_THROW((void)selectModel(BoardSpec{}, {}, candidates(), 1), std::invalid_argument);
  EXPECT_FALSE(selectModel(BoardSpec{}, {}, candidates()).has_value());
}

}  // namespace
}  // namespace servocal::calib
