// SPDX-License-Identifier: GPL-3.0-or-later
#include "yaml_text.h"

#include <algorithm>
#include <cmath>

namespace servocal::session {
namespace {

using Json = nlohmann::ordered_json;

std::string scalar(const Json& value) {
  if (value.is_number_float() && !std::isfinite(value.get<double>())) return "null";
  // JSON's numbers and quoted texts are YAML's too; texts are quoted, so none is taken for a number.
  std::string text = value.dump(-1, ' ', false, Json::error_handler_t::replace);
  if (value.is_number_float() && text.find('.') == std::string::npos) {
    const std::size_t exponent = std::min(text.find('e'), text.size());
    text.insert(exponent, ".0");
  }
  return text;
}

bool isFlat(const Json& list) {
  return std::none_of(list.begin(), list.end(), [](const Json& item) { return item.is_structured(); });
}

void write(std::string& out, const Json& value, std::size_t indent);

void writeFlat(std::string& out, const Json& list) {
  out += '[';
  for (std::size_t i = 0; i < list.size(); ++i) out += (i == 0 ? "" : ", ") + scalar(list[i]);
  out += "]\n";
}

/// The part after "key:" or "-".
void writeValue(std::string& out, const Json& value, std::size_t indent) {
  if (value.is_object() && value.empty()) {
    out += " {}\n";
  } else if (value.is_array() && isFlat(value)) {
    out += ' ';
    writeFlat(out, value);
  } else if (value.is_structured()) {
    out += '\n';
    write(out, value, indent);
  } else {
    out += ' ' + scalar(value) + '\n';
  }
}

void write(std::string& out, const Json& value, std::size_t indent) {
  const std::string margin(indent, ' ');
  if (value.is_object()) {
    for (const auto& [key, item] : value.items()) {
      out += margin + key + ':';
      writeValue(out, item, indent + 2);
    }
    return;
  }
  for (const Json& item : value) {
    if (item.is_object() && !item.empty()) {
      // The first key shares the line of its dash.
      std::string block;
      write(block, item, indent + 2);
      out += margin + "- " + block.substr(indent + 2);
    } else {
      out += margin + '-';
      writeValue(out, item, indent + 2);
    }
  }
}

}  // namespace

std::string toYaml(const Json& tree) {
  std::string out;
  write(out, tree, 0);
  return out;
}

}  // namespace servocal::session
