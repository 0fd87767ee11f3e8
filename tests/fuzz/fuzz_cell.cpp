// SPDX-License-Identifier: GPL-3.0-or-later
// Whatever a cell file says is a cell or an Error.
#include "servocal/core/cell_config.h"
#include "servocal/core/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  try {
    servocal::parseCell(std::string(reinterpret_cast<const char*>(bytes), size), "cell");
  } catch (const servocal::Error&) {
  }
  return 0;
}
