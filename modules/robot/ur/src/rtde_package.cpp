// SPDX-License-Identifier: GPL-3.0-or-later
#include "rtde_package.h"

#include <algorithm>

namespace servocal::robot::ur {
namespace {

constexpr std::size_t kHeader = 3;

/// The longest package of a type, header included; 0 for a type that does not exist.
std::size_t longest(std::uint8_t type) {
  switch (static_cast<PackageType>(type)) {
    case PackageType::kProtocolVersion:
    case PackageType::kStart:
    case PackageType::kPause: return kHeader + 1;
    case PackageType::kControllerVersion: return kHeader + 16;
    case PackageType::kTextMessage: return kHeader + 1 + 255 + 1 + 255 + 1;
    case PackageType::kSetupOutputs:
    case PackageType::kSetupInputs: return kHeader + 2048;
    case PackageType::kData: return kHeader + 2048;
  }
  return 0;
}

}  // namespace

void PackageReader::feed(const std::uint8_t* bytes, std::size_t count) {
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(start_));
  start_ = 0;
  buffer_.insert(buffer_.end(), bytes, bytes + count);
}

std::optional<Package> PackageReader::next() {
  const std::size_t held = buffer_.size() - start_;
  if (held < 2) return std::nullopt;
  const std::uint8_t* header = buffer_.data() + start_;
  const std::size_t size = static_cast<std::size_t>(header[0]) << 8 | header[1];
  if (size < kHeader) failProtocol("a package claims a size of " + std::to_string(size) + " bytes");
  if (held < kHeader) return std::nullopt;
  const std::size_t limit = longest(header[2]);
  if (limit == 0) failProtocol("a package is of the unknown type " + std::to_string(header[2]));
  if (size > limit) {
    failProtocol("a package of type '" + std::string(1, static_cast<char>(header[2])) +
                 "' claims a size of " + std::to_string(size) + " bytes, the most is " +
                 std::to_string(limit));
  }
  if (held < size) return std::nullopt;
  Package package;
  package.type = static_cast<PackageType>(header[2]);
  package.payload.assign(header + kHeader, header + size);
  start_ += size;
  return package;
}

Bytes pack(PackageType type, const Bytes& payload) {
  ByteWriter writer;
  writer.u16(static_cast<std::uint16_t>(kHeader + payload.size())).u8(static_cast<std::uint8_t>(type));
  Bytes bytes = writer.bytes();
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  return bytes;
}

std::string ControllerVersion::toString() const {
  return std::to_string(major) + "." + std::to_string(minor) + "." + std::to_string(bugfix);
}

bool decodeAccepted(const Package& package) {
  ByteReader reader(package.payload, "a reply of yes or no");
  const bool accepted = reader.u8() != 0;
  reader.finish();
  return accepted;
}

ControllerVersion decodeControllerVersion(const Package& package) {
  ByteReader reader(package.payload, "the controller's version");
  ControllerVersion version;
  version.major = reader.u32();
  version.minor = reader.u32();
  version.bugfix = reader.u32();
  version.build = reader.u32();
  reader.finish();
  return version;
}

TextMessage decodeTextMessage(const Package& package) {
  ByteReader reader(package.payload, "a text message");
  TextMessage message;
  message.text = reader.text(reader.u8());
  message.source = reader.text(reader.u8());
  message.level = reader.u8();
  reader.finish();
  return message;
}

RecipeReply decodeRecipe(const Package& package, std::size_t names) {
  ByteReader reader(package.payload, "the reply to a list of variables");
  RecipeReply reply;
  reply.id = reader.u8();
  std::string list = reader.rest();
  if (!list.empty() && list.back() == ',') list.pop_back();
  for (std::size_t begin = 0; begin <= list.size();) {
    const std::size_t comma = std::min(list.find(',', begin), list.size());
    if (comma == begin) failProtocol("a list of types has an empty entry ('" + list + "')");
    reply.types.push_back(list.substr(begin, comma - begin));
    begin = comma + 1;
  }
  if (reply.types.size() != names) {
    failProtocol("it answered " + std::to_string(reply.types.size()) + " types to " + std::to_string(names) +
                 " variables");
  }
  return reply;
}

}  // namespace servocal::robot::ur
