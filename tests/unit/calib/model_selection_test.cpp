// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/model_selection.h"

#include <gtest/gtest.h>

#include <iostream>

#include "joint_scene.h"

namespace servocal::calib {
namespace {

/// A flat board and a lens without k3,
JointOptions lean() {
  JointOptions options;
  options.board.bow = false;
  options.streams.emplace_back();
  options.streams.back().camera = "k1";
  options.streams.back().fixed = {"k3"};
  return options;
}

/// and what may be added.
std::vector<ModelTerm> terms() {
  return {{"bow", [](JointOptions& options) { options.board.bow = true; }},
          {"k3", [](JointOptions& options) { options.streams.back().fixed.clear(); }}};
}

ModelSelection select(double bow_m, double k3) {
  test::Cell cell = test::makeCell(8, 1, Mount::kFixed, false);
  cell.shape.bow_x_m = bow_m;
  cell.cameras[0].model.parameters[8] = k3;
  std::mt19937_64 random(3);
  const auto stops = test::randomStops(cell, 60, random);
  const auto observations = test::observeAll(cell, stops, {0.2, 1e-4, 2.5e-4}, random);
  const auto selection = selectModel(cell.board, observations, lean(), terms());
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
  const ModelSelection neither = select(0.0, 0.0);
  EXPECT_FALSE(neither.options.board.bow);
  EXPECT_EQ(neither.options.streams.back().fixed, std::vector<std::string>{"k3"});
  const ModelSelection bowed = select(6e-4, 0.0);
  EXPECT_TRUE(bowed.options.board.bow);
  EXPECT_EQ(bowed.options.streams.back().fixed, std::vector<std::string>{"k3"});
  EXPECT_EQ(bowed.sentence, "Supported by the views held out: bow. Not supported by the views held out: k3.");
  const ModelSelection lens = select(0.0, 0.35);
  EXPECT_FALSE(lens.options.board.bow);
  EXPECT_TRUE(lens.options.streams.back().fixed.empty());
  EXPECT_GT(lens.scores[0].rms_px, lens.score.rms_px);
}

TEST(SelectModel, ThrowsOnACallersMistakes) {
  EXPECT_THROW((void)selectModel(BoardSpec{}, {}, lean(), terms(), 1), std::invalid_argument);
  EXPECT_FALSE(selectModel(BoardSpec{}, {}, lean(), terms()).has_value());
}

}  // namespace
}  // namespace servocal::calib
