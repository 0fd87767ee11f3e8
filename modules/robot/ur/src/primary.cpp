// SPDX-License-Identifier: GPL-3.0-or-later
#include "primary.h"

namespace servocal::robot::ur {
namespace {

constexpr std::size_t kHeader = 5;
constexpr std::size_t kLongest = 65536;
constexpr std::uint8_t kRobotMessage = 20;
constexpr std::uint8_t kKeyMessage = 7;
constexpr std::uint8_t kRuntimeException = 10;

std::optional<ProgramMessage> decode(ByteReader reader) {
  reader.u64();  // timestamp
  reader.u8();   // source
  const std::uint8_t kind = reader.u8();
  ProgramMessage message;
  if (kind == kKeyMessage) {
    reader.i32();  // code
    reader.i32();  // argument
    message.text = reader.text(reader.u8());
    message.text += " " + reader.rest();
    return message;
  }
  if (kind == kRuntimeException) {
    message.kind = ProgramMessage::Kind::kRuntimeException;
    message.line = reader.i32();
    message.column = reader.i32();
    message.text = reader.rest();
    return message;
  }
  return std::nullopt;
}

}  // namespace

std::string ProgramMessage::toString() const {
  if (kind == Kind::kKey) return text;
  return "line " + std::to_string(line) + ", column " + std::to_string(column) + ": " + text;
}

void PrimaryReader::feed(const std::uint8_t* bytes, std::size_t count) {
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(start_));
  start_ = 0;
  buffer_.insert(buffer_.end(), bytes, bytes + count);
}

std::optional<ProgramMessage> PrimaryReader::next() {
  for (;;) {
    const std::size_t held = buffer_.size() - start_;
    if (held < kHeader) return std::nullopt;
    ByteReader header(buffer_.data() + start_, kHeader, "a primary package");
    const std::size_t size = header.u32();
    const std::uint8_t type = header.u8();
    if (size < kHeader || size > kLongest) {
      failProtocol("a package of the primary interface claims a size of " + std::to_string(size) + " bytes");
    }
    if (held < size) return std::nullopt;
    const std::uint8_t* payload = buffer_.data() + start_ + kHeader;
    start_ += size;
    if (type != kRobotMessage) continue;
    if (auto message = decode(ByteReader(payload, size - kHeader, "a message of the primary interface"))) {
      return message;
    }
  }
}

}  // namespace servocal::robot::ur
