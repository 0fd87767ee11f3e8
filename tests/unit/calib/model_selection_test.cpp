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

/// Cameras that have the board to themselves, one after the other, a bowed one.
std::vector<Observation> inTurns(const test::Cell& cell, const std::vector<int>& stops_of_each) {
  std::mt19937_64 random(3);
  std::vector<Observation> out;
  for (std::size_t k = 0; k < cell.cameras.size(); ++k) {
    test::Cell alone = cell;
    alone.cameras = {cell.cameras[k]};
    for (const test::CellStop& stop : test::randomStops(alone, stops_of_each[k], random)) {
      out.push_back(
          test::observe(alone, stop, static_cast<std::int64_t>(out.size()) + 1, {0.2, 1e-4, 2.5e-4}, random));
    }
  }
  return out;
}

JointOptions leanFor(const test::Cell& cell) {
  JointOptions options;
  options.board.bow = false;
  for (const test::CellCamera& camera : cell.cameras) {
    options.streams.emplace_back();
    options.streams.back().camera = camera.name;
    options.streams.back().fixed = {"k3"};
  }
  return options;
}

// A fifth of the stops in time is all that one of these five cameras ever saw.
TEST(SelectModel, ComparesCamerasThatHadTheirTurnsOneAfterTheOther) {
  test::Cell cell = test::makeCell(8, 5, Mount::kFixed, false);
  cell.shape.bow_x_m = 6e-4;
  const auto observations = inTurns(cell, {14, 14, 14, 14, 14});
  const auto selection = selectModel(cell.board, observations, leanFor(cell), {terms().front()});
  ASSERT_TRUE(selection.has_value());
  EXPECT_EQ(selection->score.views, 70);
  EXPECT_EQ(selection->sentence, "Supported by the views held out: bow.");
}

// A stream that no part can do without is not compared; the others are.
TEST(SelectModel, LeavesOutAStreamThatAPartDoesNotDetermine) {
  test::Cell cell = test::makeCell(8, 2, Mount::kFixed, false);
  cell.shape.bow_x_m = 6e-4;
  const auto observations = inTurns(cell, {40, 3});
  const auto selection = selectModel(cell.board, observations, leanFor(cell), {terms().front()});
  ASSERT_TRUE(selection.has_value());
  EXPECT_TRUE(selection->score.kept);
  EXPECT_GE(selection->score.views, 40);
  EXPECT_NE(selection->sentence.find("k2 color was not compared in "), std::string::npos)
      << selection->sentence;
  EXPECT_EQ(selection->options.streams.size(), 2u);
}

TEST(SelectModel, ThrowsOnACallersMistakes) {
  EXPECT_THROW((void)selectModel(BoardSpec{}, {}, lean(), terms(), 1), std::invalid_argument);
  EXPECT_FALSE(selectModel(BoardSpec{}, {}, lean(), terms()).has_value());
}

}  // namespace
}  // namespace servocal::calib
