// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <iostream>

namespace servocal::app {
namespace {

constexpr double kSignOfLifeS = 60.0;

double nowS() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

/// A longer line would wrap, and its first part could not be rewritten.
std::string cutToTerminal(const std::string& line) {
  winsize size{};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col < 2) return line;
  return line.substr(0, size.ws_col - 1);
}

}  // namespace

Progress::Progress()
    : terminal_(isatty(STDERR_FILENO) != 0 && environment("TERM") != "dumb"),
      escapes_(environment("NO_COLOR").empty()) {}

std::string Progress::erased() const {
  if (!open_line_) return "";
  return escapes_ ? "\r\033[K" : "\r" + std::string(open_length_, ' ') + "\r";
}

void Progress::show(const std::string& line, bool important) {
  if (terminal_) {
    const std::string text = important ? line + "\n" : cutToTerminal(line);
    std::cerr << erased() << text << std::flush;
    open_line_ = !important;
    open_length_ = text.size();
  } else if (important || nowS() - last_shown_s_ >= kSignOfLifeS) {
    std::cerr << line << std::endl;
    last_shown_s_ = nowS();
  }
}

void Progress::finish() {
  if (open_line_) std::cerr << std::endl;
  open_line_ = false;
}

}  // namespace servocal::app
