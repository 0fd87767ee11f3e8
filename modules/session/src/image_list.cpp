// SPDX-License-Identifier: GPL-3.0-or-later
#include "image_list.h"

#include <glob.h>

#include <algorithm>
#include <cctype>

namespace servocal::session {
namespace {

bool isDigit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }

/// The run of digits that starts at `at`, without leading zeros; moves `at` behind it.
std::string takeNumber(const std::string& text, std::size_t& at) {
  std::size_t end = at;
  while (end < text.size() && isDigit(text[end])) ++end;
  std::size_t first = at;
  while (first + 1 < end && text[first] == '0') ++first;
  at = end;
  return text.substr(first, end - first);
}

}  // namespace

bool naturallyBefore(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (isDigit(a[i]) && isDigit(b[j])) {
      const std::string x = takeNumber(a, i), y = takeNumber(b, j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i;
      ++j;
    }
  }
  // Equal but for leading zeros: any fixed order will do.
  return a.size() - i != b.size() - j ? a.size() - i < b.size() - j : a < b;
}

std::vector<std::string> matchingFiles(const std::filesystem::path& folder, const std::string& pattern) {
  // The folder's own name is not a pattern, whatever characters it holds.
  std::string escaped;
  for (const char c : folder.string()) {
    if (c == '*' || c == '?' || c == '[' || c == '\\') escaped += '\\';
    escaped += c;
  }
  glob_t found{};
  std::vector<std::string> names;
  if (::glob((escaped + "/" + pattern).c_str(), 0, nullptr, &found) == 0) {
    for (std::size_t i = 0; i < found.gl_pathc; ++i) {
      const std::filesystem::path file = found.gl_pathv[i];
      std::error_code ignored;
      if (std::filesystem::is_regular_file(file, ignored))
        names.push_back(file.lexically_relative(folder).string());
    }
  }
  ::globfree(&found);
  std::sort(names.begin(), names.end(), naturallyBefore);
  return names;
}

}  // namespace servocal::session
