// SPDX-License-Identifier: GPL-3.0-or-later
// Packages of the Real-Time Data Exchange (RTDE), protocol version 2: bytes in, bytes out, no socket.
// Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide".
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "bytes.h"

namespace servocal::robot::ur {

enum class PackageType : std::uint8_t {
  kProtocolVersion = 'V',
  kControllerVersion = 'v',
  kTextMessage = 'M',
  kSetupOutputs = 'O',
  kSetupInputs = 'I',
  kStart = 'S',
  kPause = 'P',
  kData = 'U',
};

struct Package {
  PackageType type = PackageType::kTextMessage;
  Bytes payload;
};

/// Cuts a byte stream into packages, however TCP split or merged them. Strict: a size below the header's or
/// above what the type can have, and a type that does not exist, are refused as soon as the header is there,
/// so that no more than one package is ever held.
class PackageReader {
 public:
  void feed(const std::uint8_t* bytes, std::size_t count);
  /// The next whole package; nothing if more bytes are needed.
  /// @throws Error (kHardwareAbsent) on a violation; the stream is lost then.
  std::optional<Package> next();

 private:
  Bytes buffer_;
  std::size_t start_ = 0;  ///< Of what was not handed out yet.
};

/// A whole package, header included.
Bytes pack(PackageType type, const Bytes& payload);

struct ControllerVersion {
  unsigned major = 0, minor = 0, bugfix = 0, build = 0;
  bool eSeries() const { return major >= 5; }
  std::string toString() const;  ///< "3.15.8"
};

struct TextMessage {
  std::string text;
  std::string source;
  int level = 3;  ///< 0 exception, 1 error, 2 warning, 3 information.
};

struct RecipeReply {
  int id = 0;                      ///< 0: refused; `types` says which name is to blame.
  std::vector<std::string> types;  ///< One per name asked for, "DOUBLE", "NOT_FOUND", "IN_USE", ...
};

/// Decoders of one package each. They throw Error (kHardwareAbsent) if it has not exactly the shape it
/// should.
bool decodeAccepted(const Package& package);
ControllerVersion decodeControllerVersion(const Package& package);
TextMessage decodeTextMessage(const Package& package);
/// A comma behind the last type, which some firmware sends, is taken as the list's end; an empty type
/// anywhere else is refused, and so is a list that has not `names` entries.
RecipeReply decodeRecipe(const Package& package, std::size_t names);

}  // namespace servocal::robot::ur
