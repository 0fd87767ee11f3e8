// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app/progress.h"

#include <unistd.h>

#include <chrono>
#include <iostream>

namespace servocal::app {
namespace {

constexpr double kPipeIntervalS = 5.0;

double nowS() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

Progress::Progress() : terminal_(isatty(STDERR_FILENO) != 0) {}

void Progress::show(const std::string& line, bool important) {
  if (terminal_) {
    std::cerr << "\r\033[K" << line << (important ? "\n" : "") << std::flush;
    open_line_ = !important;
  } else if (important || nowS() - last_shown_s_ >= kPipeIntervalS) {
    std::cerr << line << std::endl;
    last_shown_s_ = nowS();
  }
}

void Progress::finish() {
  if (open_line_) std::cerr << std::endl;
  open_line_ = false;
}

}  // namespace servocal::app
