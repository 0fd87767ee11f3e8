// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <charconv>

#include "servocal/core/board_spec.h"
#include "servocal/core/config_reader.h"

namespace servocal {
namespace {

constexpr Range kSizeM = {0.001, 1.0};
const std::vector<std::string> kKinds = {"checkerboard", "aprilgrid", "aruco_grid", "charuco", "circles",
                                         "asymmetric_circles"};
/// OpenCV's predefined dictionaries, with the number of codes.
const std::vector<std::string> kDictionaries = [] {
  std::vector<std::string> names;
  for (const char* bits : {"4x4", "5x5", "6x6", "7x7"})
    for (const char* codes : {"50", "100", "250", "1000"}) names.push_back(std::string("aruco_") + bits + "_" + codes);
  names.push_back("aruco_original");
  return names;
}();
constexpr int kAprilTagCodes = 587;  // of 36h11

int codesOf(const std::string& dictionary) {
  if (dictionary == "aruco_original") return 1024;
  return std::stoi(dictionary.substr(dictionary.rfind('_') + 1));
}

Checkerboard readCheckerboard(const ConfigReader& section) {
  Checkerboard p;
  p.squares_x = section.integer("squares_x", {3, 100});
  p.squares_y = section.integer("squares_y", {3, 100});
  p.square_size_m = section.number("square_size_m", kSizeM);
  // Demanded, because a board without the mark read as one with it is simply never found.
  if (!section.has("hollow_corner")) {
    section.fail("hollow_corner",
                 "missing key 'hollow_corner': true if one corner square of the board is "
                 "hollow, false for an ordinary checkerboard");
  }
  p.hollow_corner = section.boolean("hollow_corner", true);
  p.hollow_inner_ratio = section.number("hollow_inner_ratio", {0.2, 0.9}, p.hollow_inner_ratio);
  if (p.hollow_corner && (p.squares_x % 2 == 0 || p.squares_y % 2 == 0)) {
    section.fail("hollow_corner",
                 "a board with a hollow corner needs an odd number of squares each way, not " +
                     std::to_string(p.squares_x) + " x " + std::to_string(p.squares_y) +
                     "; for an ordinary checkerboard say hollow_corner: false");
  }
  return p;
}

TagGrid readTagGrid(const ConfigReader& section, bool april) {
  TagGrid p;
  int codes = kAprilTagCodes;
  if (!april) {
    p.family = kDictionaries[section.choice("dictionary", kDictionaries)];
    codes = codesOf(p.family);
  }
  p.tags_x = section.integer("tags_x", {1, 50});
  p.tags_y = section.integer("tags_y", {1, 50});
  p.tag_size_m = section.number("tag_size_m", kSizeM);
  p.tag_gap_m = p.tags_x * p.tags_y > 1 ? section.number("tag_gap_m", {0.0002, 1.0})
                                        : section.number("tag_gap_m", {0.0, 1.0}, 0.0);
  p.border_bits = section.integer("border_bits", {1, 2}, 1);
  p.first_id = section.integer("first_id", {0, codes - 1.0}, 0);
  const std::vector<std::string> rows = {"lower_left", "upper_left"};
  p.first_row_is_lowest = section.choice("first_tag", rows, april ? 0 : 1) == 0;
  if (p.first_id + p.tags_x * p.tags_y > codes) {
    section.fail("first_id", std::to_string(p.tags_x * p.tags_y) + " tags from code " + std::to_string(p.first_id) +
                                 " on are more than the " + std::to_string(codes) + " codes of " + p.family);
  }
  return p;
}

Charuco readCharuco(const ConfigReader& section) {
  Charuco p;
  p.squares_x = section.integer("squares_x", {3, 100});
  p.squares_y = section.integer("squares_y", {3, 100});
  p.square_size_m = section.number("square_size_m", kSizeM);
  p.marker_size_m = section.number("marker_size_m", {0.001, 0.95 * p.square_size_m});
  p.dictionary = kDictionaries[section.choice("dictionary", kDictionaries)];
  p.first_square_white = section.choice("first_square", {"black", "white"}, 0) == 1;
  if (p.squares_x * p.squares_y / 2 > codesOf(p.dictionary)) {
    section.fail("dictionary", "the board has " + std::to_string(p.squares_x * p.squares_y / 2) + " markers, " +
                                   p.dictionary + " only " + std::to_string(codesOf(p.dictionary)) + " codes");
  }
  return p;
}

CircleGrid readCircles(const ConfigReader& section, bool asymmetric) {
  CircleGrid p;
  p.asymmetric = asymmetric;
  p.circles_x = section.integer("circles_x", {3, 100});
  p.circles_y = section.integer("circles_y", {3, 100});
  p.spacing_m = section.number("spacing_m", kSizeM);
  p.diameter_m = section.number("diameter_m", {0.0005, (asymmetric ? 0.7 : 0.95) * p.spacing_m},
                                (asymmetric ? 0.35 : 0.5) * p.spacing_m);
  p.bigger_corner_ratio = section.number("bigger_corner_ratio", {1.0, 1.9}, 1.0);
  return p;
}

std::string number(double value) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;  // Shortest text that reads back the same.
  return std::string(text, end);
}
std::string quoted(const std::string& text) { return '"' + text + '"'; }

using Keys = std::vector<std::pair<std::string, std::string>>;

Keys keysOf(const Checkerboard& p) {
  return {{"kind", quoted("checkerboard")},
          {"squares_x", std::to_string(p.squares_x)},
          {"squares_y", std::to_string(p.squares_y)},
          {"square_size_m", number(p.square_size_m)},
          {"hollow_corner", p.hollow_corner ? "true" : "false"},
          {"hollow_inner_ratio", number(p.hollow_inner_ratio)}};
}
Keys keysOf(const TagGrid& p) {
  Keys keys = {{"kind", quoted(p.isAprilTag() ? "aprilgrid" : "aruco_grid")},
               {"tags_x", std::to_string(p.tags_x)},
               {"tags_y", std::to_string(p.tags_y)},
               {"tag_size_m", number(p.tag_size_m)},
               {"tag_gap_m", number(p.tag_gap_m)},
               {"border_bits", std::to_string(p.border_bits)},
               {"first_id", std::to_string(p.first_id)},
               {"first_tag", quoted(p.first_row_is_lowest ? "lower_left" : "upper_left")}};
  if (!p.isAprilTag()) keys.insert(keys.begin() + 1, {"dictionary", quoted(p.family)});
  return keys;
}
Keys keysOf(const Charuco& p) {
  return {{"kind", quoted("charuco")},
          {"squares_x", std::to_string(p.squares_x)},
          {"squares_y", std::to_string(p.squares_y)},
          {"square_size_m", number(p.square_size_m)},
          {"marker_size_m", number(p.marker_size_m)},
          {"dictionary", quoted(p.dictionary)},
          {"first_square", quoted(p.first_square_white ? "white" : "black")}};
}
Keys keysOf(const CircleGrid& p) {
  return {{"kind", quoted(p.asymmetric ? "asymmetric_circles" : "circles")},
          {"circles_x", std::to_string(p.circles_x)},
          {"circles_y", std::to_string(p.circles_y)},
          {"spacing_m", number(p.spacing_m)},
          {"diameter_m", number(p.diameter_m)},
          {"bigger_corner_ratio", number(p.bigger_corner_ratio)}};
}

}  // namespace

BoardSpec readBoard(const ConfigReader& section) {
  BoardSpec board;
  const std::string kind = kKinds[section.choice("kind", kKinds, 0)];
  if (kind == "checkerboard") board.pattern = readCheckerboard(section);
  if (kind == "aprilgrid" || kind == "aruco_grid") board.pattern = readTagGrid(section, kind == "aprilgrid");
  if (kind == "charuco") board.pattern = readCharuco(section);
  if (kind == "circles" || kind == "asymmetric_circles")
    board.pattern = readCircles(section, kind == "asymmetric_circles");
  board.margin_m = section.number("margin_m", {0.0, 1.0}, 0.5 * board.spacing());
  section.finish();
  return board;
}

BoardSpec loadBoard(const std::filesystem::path& file) { return readBoard(ConfigReader::fromFile(file)); }

std::vector<std::pair<std::string, std::string>> boardKeys(const BoardSpec& board) {
  Keys keys = std::visit([](const auto& pattern) { return keysOf(pattern); }, board.pattern);
  keys.emplace_back("margin_m", number(board.margin_m));
  return keys;
}

}  // namespace servocal
