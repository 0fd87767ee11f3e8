// SPDX-License-Identifier: GPL-3.0-or-later
// The primary interface: programs go in, states at 10 Hz and messages come out. We read the messages about
// programs only; what we do not know is skipped, because later versions add to it.
// Source: Universal Robots, "Client Interfaces", primary client.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "bytes.h"

namespace servocal::robot::ur {

struct ProgramMessage {
  enum class Kind { kKey, kRuntimeException };
  Kind kind = Kind::kKey;
  int line = 0;  ///< Of a runtime exception; from 1.
  int column = 0;
  std::string text;  ///< A key message's title ("PROGRAM_XXX_STARTED") and text, or what went wrong.
  std::string toString() const;
};

/// Cuts the stream and picks the messages about programs out of it.
class PrimaryReader {
 public:
  void feed(const std::uint8_t* bytes, std::size_t count);
  /// @throws Error (kHardwareAbsent) if a size is impossible; the stream is lost then.
  std::optional<ProgramMessage> next();

 private:
  Bytes buffer_;
  std::size_t start_ = 0;
};

}  // namespace servocal::robot::ur
