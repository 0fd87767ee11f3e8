// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

namespace servocal::app {

/// @throws Error (kRefusedToMove) unless a person can read and type here: standard input and standard error
///   output are a terminal.
void demandTerminal();

/// Shows `text` and waits for a line; without spaces around it. What was typed before is thrown away: nobody
/// consents to what they have not seen. Empty if the terminal is closed.
std::string askAtTerminal(const std::string& text);

}  // namespace servocal::app
