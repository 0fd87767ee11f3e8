// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

#include "servocal/core/board_spec.h"

namespace servocal::board {

/// Writes the board as a vector PDF at true size, with a ruler to check the print and the board's data
/// as a line of text. The page is the smallest of A4, A3, A2, A1, A0 (landscape) that holds it.
/// @throws Error (kBadData) if the file cannot be written; std::invalid_argument if no page holds it.
void printBoard(const BoardSpec& board, const std::filesystem::path& pdf);

}  // namespace servocal::board
