// SPDX-License-Identifier: GPL-3.0-or-later
// Whatever a board file says is a board that can be described and measured, or an Error.
#include "servocal/core/board_spec.h"
#include "servocal/core/config_reader.h"
#include "servocal/core/error.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace servocal;
  try {
    const BoardSpec board =
        readBoard(ConfigReader::fromText(std::string(reinterpret_cast<const char*>(bytes), size), "board"));
    board.describe();
    board.corners();
    boardKeys(board);
  } catch (const Error&) {
  }
  return 0;
}
