// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <string>

namespace servocal::app {

/// A progress line on stderr: rewritten in place on a terminal, a line every few seconds elsewhere.
class Progress {
 public:
  Progress();
  /// `important` lines stay.
  void show(const std::string& line, bool important = false);
  /// Leaves the last line standing.
  void finish();

 private:
  bool terminal_;
  bool open_line_ = false;
  double last_shown_s_ = -1e9;
};

}  // namespace servocal::app
