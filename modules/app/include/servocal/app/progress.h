// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <string>

namespace servocal::app {

/// A progress line on stderr. On a terminal it is rewritten in place and cut to its width; elsewhere (a pipe,
/// a file, TERM=dumb) only important lines appear, and one line a minute as a sign of life. With NO_COLOR set
/// (no-color.org) no escape sequence is written at all.
class Progress {
 public:
  Progress();
  /// `important` lines stay.
  void show(const std::string& line, bool important = false);
  /// Leaves the last line standing.
  void finish();

 private:
  std::string erased() const;

  bool terminal_;
  bool escapes_;  ///< The terminal may get escape sequences.
  bool open_line_ = false;
  std::size_t open_length_ = 0;
  double last_shown_s_ = -1e9;
};

}  // namespace servocal::app
