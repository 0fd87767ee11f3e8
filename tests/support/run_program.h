// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <sys/wait.h>

#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>

#include "temporary_folder.h"

namespace servocal::test {

struct ProgramRun {
  int exit_code = -1;  ///< -1 if it was ended by a signal.
  std::string out;
  std::string err;
};

/// Text as one word of a shell command.
inline std::string shellWord(const std::string& text) {
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

/// Runs a shell command and waits for its end.
inline ProgramRun runProgram(const std::string& command) {
  const TemporaryFolder folder;
  const std::string out = (folder / "out").string(), err = (folder / "err").string();
  const int status = std::system((command + " > " + shellWord(out) + " 2> " + shellWord(err)).c_str());
  const auto slurp = [](const std::string& file) {
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str();
  };
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, slurp(out), slurp(err)};
}

}  // namespace servocal::test
