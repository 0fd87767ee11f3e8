// SPDX-License-Identifier: GPL-3.0-or-later
#include "config_text.h"

#include <fstream>
#include <sstream>

#include "servocal/core/error.h"

namespace servocal {

std::string readConfigText(const std::filesystem::path& file) {
  const auto refuse = [&](const char* cause) {
    throw Error(ErrorKind::kInvalidConfig, "cannot read '" + file.string() + "': " + cause);
  };
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) refuse("there is no such file");
  if (std::filesystem::is_directory(file, ignored)) refuse("it is a folder");
  std::ifstream in(file, std::ios::binary);
  if (!in) refuse("it cannot be opened");
  std::ostringstream text;
  text << in.rdbuf();
  if (in.bad()) refuse("reading it failed");
  if (text.str().empty()) refuse("it is empty");
  return text.str();
}

}  // namespace servocal
