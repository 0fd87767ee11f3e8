// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "servocal/core/error.h"

namespace servocal::robot::ur {

using Bytes = std::vector<std::uint8_t>;

/// The controller broke its own protocol. Whoever catches it holds the arm and drops the link.
[[noreturn]] inline void failProtocol(const std::string& what) {
  throw Error(
      ErrorKind::kHardwareAbsent,
      "The controller's answer cannot be understood: " + what +
          ". The arm was told to stop and the link was dropped. Check that nothing stands between this "
          "computer and the controller, then start again.");
}

/// Reads big-endian numbers off a package. Reading past the end is a protocol failure that names the package.
class ByteReader {
 public:
  ByteReader(const Bytes& bytes, const char* what) : ByteReader(bytes.data(), bytes.size(), what) {}
  ByteReader(const std::uint8_t* bytes, std::size_t size, const char* what)
      : next_(bytes), end_(bytes + size), what_(what) {}

  std::size_t left() const { return static_cast<std::size_t>(end_ - next_); }
  std::uint8_t u8() { return static_cast<std::uint8_t>(number(1)); }
  std::uint16_t u16() { return static_cast<std::uint16_t>(number(2)); }
  std::uint32_t u32() { return static_cast<std::uint32_t>(number(4)); }
  std::int32_t i32() { return static_cast<std::int32_t>(u32()); }
  std::uint64_t u64() { return number(8); }
  double f64() {
    const std::uint64_t bits = u64();
    double value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }
  /// The next `size` bytes; what is not printable becomes '?', because it is going to be shown to people.
  std::string text(std::size_t size) {
    require(size);
    std::string text(next_, next_ + size);
    for (char& c : text) {
      if (static_cast<unsigned char>(c) < 32 || static_cast<unsigned char>(c) > 126) c = '?';
    }
    next_ += size;
    return text;
  }
  std::string rest() { return text(left()); }
  void finish() const {
    if (left() > 0) {
      failProtocol(std::string(what_) + " is " + std::to_string(left()) + " bytes longer than it should be");
    }
  }

 private:
  void require(std::size_t size) const {
    if (left() < size) failProtocol(std::string(what_) + " ends too early");
  }
  std::uint64_t number(std::size_t size) {
    require(size);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < size; ++i) value = value << 8 | *next_++;
    return value;
  }

  const std::uint8_t* next_;
  const std::uint8_t* end_;
  const char* what_;
};

/// Appends big-endian numbers.
class ByteWriter {
 public:
  ByteWriter& u8(std::uint8_t value) { return number(value, 1); }
  ByteWriter& u16(std::uint16_t value) { return number(value, 2); }
  ByteWriter& i32(std::int32_t value) { return number(static_cast<std::uint32_t>(value), 4); }
  ByteWriter& f64(double value) {
    std::uint64_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    return number(bits, 8);
  }
  ByteWriter& text(const std::string& text) {
    bytes_.insert(bytes_.end(), text.begin(), text.end());
    return *this;
  }
  const Bytes& bytes() const { return bytes_; }

 private:
  ByteWriter& number(std::uint64_t value, int size) {
    for (int shift = 8 * (size - 1); shift >= 0; shift -= 8) {
      bytes_.push_back(static_cast<std::uint8_t>(value >> shift & 0xff));
    }
    return *this;
  }
  Bytes bytes_;
};

}  // namespace servocal::robot::ur
