// SPDX-License-Identifier: GPL-3.0-or-later
#include "rtde_package.h"

#include <gtest/gtest.h>

#include <random>

#include "errors.h"
#include "primary.h"
#include "rtde_fields.h"

namespace servocal::robot::ur {
namespace {

using test::expectPart;
using test::messageOf;

Package packageOf(PackageType type, const Bytes& payload) { return {type, payload}; }
Bytes bytesOf(const std::string& text) { return Bytes(text.begin(), text.end()); }

Bytes stateBytes(double first) {
  ByteWriter writer;
  writer.u8(1).f64(first);
  for (int i = 0; i < 24; ++i) writer.f64(0.25 * i);
  writer.i32(7).i32(1).i32(3).i32(2).f64(1.0).f64(0.5).f64(0.3).i32(2).i32(-4).i32(99).i32(17);
  return writer.bytes();
}

std::string refusal(const Bytes& bytes) {
  return messageOf(ErrorKind::kHardwareAbsent, [&] {
    PackageReader reader;
    reader.feed(bytes.data(), bytes.size());
    while (reader.next()) {
    }
  });
}

TEST(PackageReader, PutsTogetherWhatTcpSplitAndTakesApartWhatItMerged) {
  Bytes stream = pack(PackageType::kStart, {1});
  const Bytes data = pack(PackageType::kData, stateBytes(4.5));
  stream.insert(stream.end(), data.begin(), data.end());
  stream.insert(stream.end(), data.begin(), data.end());
  for (const std::size_t piece : {std::size_t{1}, std::size_t{2}, std::size_t{7}, stream.size()}) {
    PackageReader reader;
    std::vector<Package> packages;
    for (std::size_t at = 0; at < stream.size(); at += piece) {
      reader.feed(stream.data() + at, std::min(piece, stream.size() - at));
      while (auto package = reader.next()) packages.push_back(*package);
    }
    ASSERT_EQ(packages.size(), 3u) << piece;
    EXPECT_EQ(packages[0].type, PackageType::kStart);
    EXPECT_EQ(packages[2].payload, stateBytes(4.5));
  }
}

TEST(PackageReader, RefusesImpossibleHeaders) {
  expectPart(refusal({0, 0, 'U'}), "claims a size of 0 bytes");
  expectPart(refusal({0, 2}), "claims a size of 2 bytes");
  expectPart(refusal({0xff, 0xff, 'U'}), "claims a size of 65535 bytes");
  expectPart(refusal({0, 5, 'S', 1, 1}), "a package of type 'S' claims a size of 5 bytes, the most is 4");
  expectPart(refusal({0, 5, 'X'}), "unknown type 88");
}

TEST(Decode, StateHoldsEveryVariableInItsPlace) {
  const ControllerState state = decodeState(packageOf(PackageType::kData, stateBytes(4.5)), 1);
  EXPECT_EQ(state.timestamp_s, 4.5);
  EXPECT_EQ(state.actual_q[1], 0.25);
  EXPECT_EQ(state.actual_tcp_pose[0], 1.5);
  EXPECT_EQ(state.actual_tcp_speed[0], 3.0);
  EXPECT_EQ(state.tcp_offset[5], 5.75);
  EXPECT_EQ(state.robot_mode, 7);
  EXPECT_EQ(state.safety_mode, 1);
  EXPECT_EQ(state.robot_status_bits, 3u);
  EXPECT_TRUE(state.programRuns());
  EXPECT_EQ(state.speed_slider, 1.0);
  EXPECT_EQ(state.speed_scaling, 0.5);
  EXPECT_EQ(state.payload_kg, 0.3);
  EXPECT_EQ(state.script_epoch, -4);
  EXPECT_EQ(state.script_token, 99);
  EXPECT_EQ(state.script_beat, 17);
}

TEST(Decode, StateOfAnotherShapeIsRefused) {
  const auto refused = [](Bytes bytes, int recipe) {
    return messageOf(ErrorKind::kHardwareAbsent,
                     [&] { decodeState(packageOf(PackageType::kData, bytes), recipe); });
  };
  Bytes bytes = stateBytes(1.0);
  expectPart(refused(bytes, 2), "recipe 1 came, only 2 was asked for");
  bytes.pop_back();
  expectPart(refused(bytes, 1), "a data package ends too early");
  bytes.insert(bytes.end(), 5, 0);
  expectPart(refused(bytes, 1), "4 bytes longer");
  expectPart(refused(stateBytes(std::numeric_limits<double>::quiet_NaN()), 1), "not finite");
}

TEST(Decode, ListsOfTypes) {
  const auto decode = [](const std::string& list, std::size_t names) {
    return decodeRecipe(packageOf(PackageType::kSetupOutputs, bytesOf("\x03" + list)), names);
  };
  EXPECT_EQ(decode("DOUBLE,INT32", 2).types, (std::vector<std::string>{"DOUBLE", "INT32"}));
  EXPECT_EQ(decode("DOUBLE,INT32", 2).id, 3);
  EXPECT_EQ(decode("DOUBLE,INT32,", 2).types.size(), 2u);  // A comma at the end, as some firmware sends.
  const auto refused = [&](const std::string& list, std::size_t names) {
    return messageOf(ErrorKind::kHardwareAbsent, [&] { decode(list, names); });
  };
  expectPart(refused("DOUBLE,,INT32", 3), "empty entry");
  expectPart(refused("DOUBLE,INT32,,", 3), "empty entry");
  expectPart(refused("DOUBLE", 2), "1 types to 2 variables");
}

TEST(Decode, TextMessages) {
  const Bytes good = {2, 'h', 'i', 4, 'R', 'T', 'D', 'E', 1};
  const TextMessage message = decodeTextMessage(packageOf(PackageType::kTextMessage, good));
  EXPECT_EQ(message.text, "hi");
  EXPECT_EQ(message.source, "RTDE");
  EXPECT_EQ(message.level, 1);
  const Bytes lying = {200, 'h', 'i', 4, 'R', 'T', 'D', 'E', 1};
  expectPart(messageOf(ErrorKind::kHardwareAbsent,
                       [&] { decodeTextMessage(packageOf(PackageType::kTextMessage, lying)); }),
             "ends too early");
}

TEST(PrimaryReader, PicksProgramMessagesOutOfTheStream) {
  ByteWriter state, exception, key;
  state.i32(9).u8(16).i32(77);
  exception.i32(5 + 10 + 8 + 9).u8(20).f64(0.0).u8(254).u8(10).i32(3).i32(5).text("bad\nthing");
  key.i32(5 + 10 + 8 + 1 + 5 + 4).u8(20).f64(0.0).u8(254).u8(7).i32(0).i32(0).u8(5).text("TITLEname");
  Bytes stream = state.bytes();
  for (const ByteWriter* more : {&exception, &state, &key}) {
    stream.insert(stream.end(), more->bytes().begin(), more->bytes().end());
  }
  PrimaryReader reader;
  std::vector<ProgramMessage> messages;
  for (const std::uint8_t byte : stream) {
    reader.feed(&byte, 1);
    while (auto message = reader.next()) messages.push_back(*message);
  }
  ASSERT_EQ(messages.size(), 2u);
  EXPECT_EQ(messages[0].toString(), "line 3, column 5: bad?thing");
  EXPECT_EQ(messages[1].toString(), "TITLE name");
  const Bytes zero = {0, 0, 0, 0, 20};
  PrimaryReader broken;
  broken.feed(zero.data(), zero.size());
  expectPart(messageOf(ErrorKind::kHardwareAbsent, [&] { broken.next(); }), "claims a size of 0 bytes");
}

// What the fuzzer does for hours, for a moment: whatever comes, it ends in a package or in an Error.
TEST(PackageReader, SpoiltStreamsEndInAnErrorOrInPackages) {
  std::mt19937 random(5);
  Bytes good = pack(PackageType::kData, stateBytes(1.0));
  const Bytes text = pack(PackageType::kTextMessage, {2, 'h', 'i', 1, 'R', 1});
  good.insert(good.end(), text.begin(), text.end());
  int refused = 0, decoded = 0;
  for (int round = 0; round < 20000; ++round) {
    Bytes bytes = good;
    for (unsigned change = 0; change <= random() % 3; ++change) bytes[random() % bytes.size()] = random();
    try {
      PackageReader reader;
      reader.feed(bytes.data(), bytes.size());
      while (const auto package = reader.next()) {
        if (package->type == PackageType::kData) decodeState(*package, 1);
        if (package->type == PackageType::kTextMessage) decodeTextMessage(*package);
        ++decoded;
      }
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 100);
  EXPECT_GT(decoded, 100);
}

}  // namespace
}  // namespace servocal::robot::ur
