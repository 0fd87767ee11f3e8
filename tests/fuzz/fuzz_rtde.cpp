// SPDX-License-Identifier: GPL-3.0-or-later
// Whatever the network sends ends in packages or in an Error; never in a crash, a hang or a growing buffer.
#include <algorithm>
#include <cstdint>

#include "primary.h"
#include "rtde_fields.h"
#include "rtde_package.h"

namespace {

using namespace servocal;
using namespace servocal::robot::ur;

void decodeAny(const Package& package) {
  switch (package.type) {
    case PackageType::kData: decodeState(package, 1); break;
    case PackageType::kTextMessage: decodeTextMessage(package); break;
    case PackageType::kControllerVersion: decodeControllerVersion(package); break;
    case PackageType::kSetupOutputs: checkOutputs(decodeRecipe(package, outputNames().size())); break;
    case PackageType::kSetupInputs: checkInputs(decodeRecipe(package, inputNames().size())); break;
    default: decodeAccepted(package);
  }
}

/// The stream in pieces of `piece` bytes, as TCP may deliver it.
template <class Reader, class Use>
void read(const std::uint8_t* bytes, std::size_t size, std::size_t piece, const Use& use) {
  Reader reader;
  for (std::size_t at = 0; at < size; at += piece) {
    reader.feed(bytes + at, std::min(piece, size - at));
    while (const auto found = reader.next()) {
      try {
        use(*found);
      } catch (const Error&) {  // One bad package must not hide those behind it from the fuzzer.
      }
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  if (size < 1) return 0;
  const std::size_t piece = 1 + bytes[0] % 64;
  try {
    if (bytes[0] < 200) {
      read<PackageReader>(bytes + 1, size - 1, piece, decodeAny);
    } else {
      read<PrimaryReader>(bytes + 1, size - 1, piece,
                          [](const ProgramMessage& message) { message.toString(); });
    }
  } catch (const Error&) {
  }
  return 0;
}
