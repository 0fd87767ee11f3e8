// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "errors.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/config_reader.h"

namespace servocal {
namespace {

BoardSpec read(const std::string& text) { return readBoard(ConfigReader::fromText(text, "board.yaml")); }

std::string refusal(const std::string& text) {
  return test::messageOf(ErrorKind::kInvalidConfig, [&] { read(text); });
}

TEST(BoardFile, ReadsAnOrdinaryCheckerboard) {
  const BoardSpec board = read("squares_x: 10\nsquares_y: 7\nsquare_size_m: 0.025\nhollow_corner: false\n");
  const Checkerboard& squares = *board.as<Checkerboard>();
  EXPECT_EQ(squares.cornersX(), 9);
  EXPECT_EQ(squares.cornersY(), 6);
  EXPECT_EQ(squares.square_size_m, 0.025);
  EXPECT_FALSE(squares.hollow_corner);
  EXPECT_EQ(board.margin_m, 0.0125);
}

TEST(BoardFile, HollowCornerNeedsOddByOdd) {
  EXPECT_EQ(
      refusal("squares_x: 8\nsquares_y: 5\nsquare_size_m: 0.03\nhollow_corner: true\n"),
      "board.yaml:4: a board with a hollow corner needs an odd number of squares each way, not 8 x 5; for "
      "an ordinary checkerboard say hollow_corner: false");
}

TEST(BoardFile, MillimetresAreRefusedByTheRange) {
  EXPECT_EQ(refusal("squares_x: 7\nsquares_y: 5\nsquare_size_m: 30\nhollow_corner: true\n"),
            "board.yaml:3: 'square_size_m' is 30, allowed: 0.001 to 1");
}

TEST(BoardFile, MarkMustBeStated) {
  test::expectPart(refusal("squares_x: 7\nsquares_y: 5\nsquare_size_m: 0.03\n"),
                   "missing key 'hollow_corner'");
}

}  // namespace
}  // namespace servocal
