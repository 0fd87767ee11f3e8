// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/report/page.h"

#include <stdexcept>
#include <string_view>

#include "page_files.h"

namespace servocal::report {
namespace {

/// Inside a script element only "<" could end it; JSON may write it as an escape.
std::string withoutTags(const std::string& json) {
  std::string text;
  text.reserve(json.size());
  for (const char c : json) c == '<' ? text += "\\u003c" : text += c;
  return text;
}

}  // namespace

std::string reportPage(const std::string& json) {
  const std::string_view page = pageTemplate();
  std::string text;
  std::size_t at = 0;
  const auto insert = [&](std::string_view mark, std::string_view content) {
    const std::size_t found = page.find(mark, at);
    if (found == std::string_view::npos)
      throw std::logic_error("the page's template lacks " + std::string(mark));
    text.append(page.substr(at, found - at)).append(content);
    at = found + mark.size();
  };
  insert("@STYLE@", pageStyle());
  insert("@DATA@", withoutTags(json));
  insert("@SCRIPT@", pageScript());
  return text.append(page.substr(at));
}

}  // namespace servocal::report
