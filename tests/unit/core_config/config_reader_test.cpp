// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/config_reader.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "errors.h"

namespace servocal {
namespace {

using test::expectPart;
using test::messageOf;

ConfigReader read(const std::string& text) { return ConfigReader::fromText(text, "x.yaml"); }

std::string refusal(const std::function<void()>& action) {
  return messageOf(ErrorKind::kInvalidConfig, action);
}

TEST(ConfigReader, ReadsEveryType) {
  const ConfigReader reader = read(
      "name: left\nspeed_mps: 0.25\ncount: 7\non: true\nlist: [1, 2.5, -3e-2]\nwords: [a, b]\n"
      "mode: fast\npoint_m: [1, 2, 3]\n");
  EXPECT_EQ(reader.text("name"), "left");
  EXPECT_EQ(reader.number("speed_mps", {0, 1}), 0.25);
  EXPECT_EQ(reader.integer("count", {0, 10}), 7);
  EXPECT_TRUE(reader.boolean("on", false));
  EXPECT_EQ(reader.numbers("list", 0, {}), (std::vector<double>{1, 2.5, -3e-2}));
  EXPECT_EQ(reader.texts("words"), (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(reader.choice("mode", {"slow", "fast"}), 1u);
  EXPECT_EQ(reader.vector3("point_m", {}), Eigen::Vector3d(1, 2, 3));
  reader.finish();
}

TEST(ConfigReader, FallbacksApplyOnlyToAbsentKeys) {
  const ConfigReader reader = read("speed_mps: 3\n");
  EXPECT_EQ(reader.number("other", {0, 1}, 0.5), 0.5);
  EXPECT_EQ(reader.integer("count", {0, 1}, 1), 1);
  EXPECT_EQ(reader.text("word", "w"), "w");
  EXPECT_EQ(reader.choice("mode", {"a", "b"}, 1), 1u);
  EXPECT_EQ(reader.numbers("list", 2, {}, {1, 2}).size(), 2u);
  EXPECT_EQ(refusal([&] {
              reader.number("speed_mps", {0, 1}, 0.5);
            }),
            "x.yaml:1: 'speed_mps' is 3, allowed: 0 to 1");
}

TEST(ConfigReader, UnknownKeyNamesLineAndNearest) {
  const ConfigReader reader = read("# comment\nname: a\n\nspede_mps: 0.2\n");
  reader.text("name");
  reader.number("speed_mps", {0, 1}, 0.1);
  EXPECT_EQ(refusal([&] { reader.finish(); }),
            "x.yaml:4: unknown key 'spede_mps'; did you mean 'speed_mps'?");
}

TEST(ConfigReader, KeyWithoutItsUnitIsRecognized) {
  const ConfigReader reader = read("square_size: 0.03\n");
  EXPECT_EQ(refusal([&] {
              reader.number("square_size_m", {0, 1});
            }),
            "x.yaml:1: unknown key 'square_size'; did you mean 'square_size_m'?");
}

TEST(ConfigReader, UnknownKeyFarFromAllListsThem) {
  const ConfigReader reader = read("color: red\n");
  reader.has("speed_mps");
  reader.has("name");
  EXPECT_EQ(refusal([&] { reader.finish(); }),
            "x.yaml:1: unknown key 'color'; valid keys here: name, speed_mps");
}

TEST(ConfigReader, MissingKeyNamesItsSection) {
  const ConfigReader reader = read("name: a\narm:\n  urdf: ur5\n");
  const ConfigReader arm = reader.section("arm");
  EXPECT_EQ(refusal([&] { arm.text("backend"); }), "x.yaml:2: missing key 'backend' in 'arm'");
  EXPECT_EQ(refusal([&] { reader.text("limits"); }), "x.yaml:1: missing key 'limits'");
}

TEST(ConfigReader, WrongTypesNameLineAndValue) {
  const ConfigReader reader =
      read("a: fast\nb: [1]\nc: 2.5\nd: yes\ne: 3\nf: {x: 1}\ng:\nh: \"3\"\ni: [1, x]\n");
  EXPECT_EQ(refusal([&] { reader.number("a", {}); }), "x.yaml:1: 'a' must be a number, not 'fast'");
  EXPECT_EQ(refusal([&] { reader.number("b", {}); }), "x.yaml:2: 'b' must be a number, not a list of 1");
  EXPECT_EQ(refusal([&] { reader.integer("c", {}); }), "x.yaml:3: 'c' must be a whole number, not '2.5'");
  EXPECT_EQ(refusal([&] { reader.boolean("d", true); }), "x.yaml:4: 'd' must be true or false, not 'yes'");
  EXPECT_EQ(refusal([&] { reader.section("e"); }),
            "x.yaml:5: 'e' must be a mapping (lines of 'key: value'), not '3'");
  EXPECT_EQ(refusal([&] { reader.text("f"); }), "x.yaml:6: 'f' must be a text, not a mapping");
  EXPECT_EQ(refusal([&] { reader.number("g", {}); }), "x.yaml:7: 'g' must be a number, not nothing");
  EXPECT_EQ(refusal([&] { reader.number("h", {}); }), "x.yaml:8: 'h' must be a number, not '3'");
  EXPECT_EQ(refusal([&] { reader.numbers("i", 2, {}); }),
            "x.yaml:9: 'i' must be a list of 2 numbers, not 'x'");
  EXPECT_EQ(refusal([&] { reader.numbers("i", 3, {}); }),
            "x.yaml:9: 'i' must be a list of 3 numbers, not a list of 2");
  EXPECT_EQ(refusal([&] {
              reader.choice("a", {"slow", "quick"});
            }),
            "x.yaml:1: 'a' is 'fast', allowed: slow, quick");
}

TEST(ConfigReader, OutOfRangeNamesTheRange) {
  const ConfigReader reader = read("a: 3\nb: -1\nc: 99999999999\nd: [1, 200]\n");
  EXPECT_EQ(refusal([&] { reader.number("a", {0.5, 1.5}); }), "x.yaml:1: 'a' is 3, allowed: 0.5 to 1.5");
  EXPECT_EQ(refusal([&] {
              reader.number("b", {0, Range{}.max});
            }),
            "x.yaml:2: 'b' is -1, allowed: at least 0");
  expectPart(refusal([&] { reader.integer("c", {}); }), "x.yaml:3: 'c' is 99999999999, allowed: ");
  EXPECT_EQ(refusal([&] { reader.numbers("d", 2, {0, 100}); }), "x.yaml:4: 'd' is 200, allowed: 0 to 100");
}

TEST(ConfigReader, NonFiniteIsRefusedHoweverSpelled) {
  for (const char* value : {".nan", "nan", "NaN", ".inf", "-.inf", "inf", "1e999"}) {
    const ConfigReader reader = read(std::string("a: ") + value + "\n");
    expectPart(refusal([&] { reader.number("a", {0, 1}); }), "x.yaml:1: 'a' must be finite, not '");
  }
}

TEST(ConfigReader, DuplicateKeyIsRefused) {
  EXPECT_EQ(refusal([] { read("a: 1\nb: 2\na: 3\n"); }), "x.yaml:3: key 'a' was already given in line 1");
}

TEST(ConfigReader, MalformedYamlNamesItsLine) {
  expectPart(refusal([] { read("a: 1\nb: [1, 2\nc: 3\n"); }), "x.yaml:3: not YAML: ");
  expectPart(refusal([] { read("just words\n"); }), "x.yaml:1: the file must be a mapping");
  expectPart(refusal([] { read(std::string(100000, '[')); }), "not YAML");
}

TEST(ConfigReader, UnreadableFileNamesCause) {
  EXPECT_EQ(refusal([] { ConfigReader::fromFile("/nowhere/cell.yaml"); }),
            "cannot read '/nowhere/cell.yaml': there is no such file");
  expectPart(refusal([] { ConfigReader::fromFile(std::filesystem::temp_directory_path()); }),
             "it is a folder");
}

TEST(ConfigReader, SectionsOfAListKnowTheirLines) {
  const ConfigReader reader = read("boxes:\n  - name: a\n  - name: b\n    colour: red\n");
  const std::vector<ConfigReader> boxes = reader.sections("boxes");
  ASSERT_EQ(boxes.size(), 2u);
  EXPECT_EQ(boxes[1].text("name"), "b");
  boxes[0].text("name");
  boxes[0].finish();
  EXPECT_EQ(refusal([&] { boxes[1].finish(); }),
            "x.yaml:4: unknown key 'colour' in 'boxes[1]'; valid keys here: name");
}

TEST(ConfigReader, CallersChecksPointToTheKey) {
  const ConfigReader reader = read("a: 1\nb: 2\n");
  EXPECT_EQ(refusal([&] { reader.fail("b", "b must be below a"); }), "x.yaml:2: b must be below a");
}

}  // namespace
}  // namespace servocal
