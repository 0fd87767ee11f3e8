// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/board_spec.h"
#include "servocal/core/config_reader.h"

namespace servocal {

BoardSpec readBoard(const ConfigReader& section) {
  BoardSpec board;
  board.squares_x = section.integer("squares_x", {3, 100});
  board.squares_y = section.integer("squares_y", {3, 100});
  board.square_size_m = section.number("square_size_m", {0.001, 1.0});
  // Demanded, because a board without the mark read as one with it is simply never found.
  if (!section.has("hollow_corner")) {
    section.fail("hollow_corner",
                 "missing key 'hollow_corner': true if one corner square of the board is "
                 "hollow, false for an ordinary checkerboard");
  }
  board.hollow_corner = section.boolean("hollow_corner", true);
  board.hollow_inner_ratio = section.number("hollow_inner_ratio", {0.2, 0.9}, board.hollow_inner_ratio);
  board.margin_m = section.number("margin_m", {0.0, 1.0}, 0.5 * board.square_size_m);
  section.finish();
  if (board.hollow_corner && (board.squares_x % 2 == 0 || board.squares_y % 2 == 0)) {
    section.fail("hollow_corner",
                 "a board with a hollow corner needs an odd number of squares each way, not " +
                     std::to_string(board.squares_x) + " x " + std::to_string(board.squares_y) +
                     "; for an ordinary checkerboard say hollow_corner: false");
  }
  return board;
}

BoardSpec loadBoard(const std::filesystem::path& file) { return readBoard(ConfigReader::fromFile(file)); }

}  // namespace servocal
