// SPDX-License-Identifier: GPL-3.0-or-later
#include "consent.h"

#include <termios.h>
#include <unistd.h>

#include <iostream>

#include "servocal/core/error.h"

namespace servocal::app {

void demandTerminal() {
  if (::isatty(STDIN_FILENO) != 0 && ::isatty(STDERR_FILENO) != 0) return;
  throw Error(ErrorKind::kRefusedToMove,
              "A real arm moves only after its serial number was typed at a terminal. Start this program in "
              "one, with "
              "neither its input nor its error output redirected.");
}

std::string askAtTerminal(const std::string& text) {
  ::tcflush(STDIN_FILENO, TCIFLUSH);
  std::cerr << text << std::flush;
  std::string line;
  std::getline(std::cin, line);
  const auto begin = line.find_first_not_of(" \t\r");
  if (begin == std::string::npos) return "";
  return line.substr(begin, line.find_last_not_of(" \t\r") - begin + 1);
}

}  // namespace servocal::app
