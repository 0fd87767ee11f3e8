// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/config_reader.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <sstream>

#include "config_text.h"
#include "edit_distance.h"
#include "servocal/core/error.h"

namespace servocal {
namespace {

std::string inQuotes(std::string_view text) { return "'" + std::string(text) + "'"; }

std::string joined(const std::vector<std::string>& texts) {
  std::string all;
  for (const std::string& text : texts) all += (all.empty() ? "" : ", ") + text;
  return all;
}

std::string formatted(double value) {
  std::ostringstream out;
  out.precision(10);
  out << value;
  return out.str();
}

std::string allowed(Range range) {
  if (std::isinf(range.min) && std::isinf(range.max)) return "any finite number";
  if (std::isinf(range.max)) return "at least " + formatted(range.min);
  if (std::isinf(range.min)) return "at most " + formatted(range.max);
  return formatted(range.min) + " to " + formatted(range.max);
}

/// What a wrong value looks like in a message; long ones are cut.
std::string shown(const YAML::Node& node) {
  if (node.IsNull()) return "nothing";
  if (node.IsMap()) return "a mapping";
  if (node.IsSequence()) return "a list of " + std::to_string(node.size());
  const std::string text = node.Scalar();
  return inQuotes(text.size() > 40 ? text.substr(0, 37) + "..." : text);
}

int lineOf(const YAML::Node& node) { return node.Mark().line + 1; }

}  // namespace

struct ConfigReader::Impl {
  struct Entry {
    std::string key;
    int line;
    YAML::Node value;
  };

  std::string origin;
  std::string path;  ///< Where this mapping sits in the file, e.g. "limits.keep_out[1]"; empty at the top.
  int line = 1;
  std::vector<Entry> entries;
  mutable std::set<std::string, std::less<>> known;

  [[noreturn]] void failAt(int at_line, const std::string& what) const {
    throw Error(ErrorKind::kInvalidConfig, origin + ":" + std::to_string(at_line) + ": " + what);
  }

  std::string inPath() const { return path.empty() ? "" : " in " + inQuotes(path); }

  static std::unique_ptr<Impl> make(const YAML::Node& node, const std::string& origin,
                                    const std::string& path, int line) {
    auto impl = std::make_unique<Impl>();
    impl->origin = origin;
    impl->path = path;
    impl->line = line;
    if (!node.IsMap()) {
      impl->failAt(line, (path.empty() ? std::string("the file") : inQuotes(path)) +
                             " must be a mapping (lines of 'key: value'), not " + shown(node));
    }
    for (const auto& item : node) {
      if (!item.first.IsScalar()) impl->failAt(lineOf(item.first), "a key must be a word");
      const std::string key = item.first.Scalar();
      const int key_line = lineOf(item.first);
      for (const Entry& entry : impl->entries) {
        if (entry.key == key) {
          impl->failAt(key_line,
                       "key " + inQuotes(key) + " was already given in line " + std::to_string(entry.line));
        }
      }
      impl->entries.push_back({key, key_line, item.second});
    }
    return impl;
  }

  const Entry* find(std::string_view key) const {
    known.emplace(key);
    for (const Entry& entry : entries) {
      if (entry.key == key) return &entry;
    }
    return nullptr;
  }

  const Entry& need(std::string_view key) const {
    if (const Entry* entry = find(key)) return *entry;
    // A misspelled key is the likely cause of a missing one, and its line is what helps.
    for (const Entry& entry : entries) {
      if (known.count(entry.key) == 0 && isNear(entry.key, key)) refuseUnknown(entry);
    }
    failAt(line, "missing key " + inQuotes(key) + inPath());
  }

  [[noreturn]] void refuseUnknown(const Entry& entry) const {
    const std::string* nearest = nullptr;
    for (const std::string& candidate : known) {
      if (nearest == nullptr || editDistance(entry.key, candidate) < editDistance(entry.key, *nearest)) {
        nearest = &candidate;
      }
    }
    std::string message = "unknown key " + inQuotes(entry.key);
    if (nearest != nullptr && isNear(entry.key, *nearest)) {
      message += "; did you mean " + inQuotes(*nearest) + "?";
    } else {
      message +=
          inPath() + "; valid keys here: " + joined(std::vector<std::string>(known.begin(), known.end()));
    }
    failAt(entry.line, message);
  }

  const std::string& scalar(const Entry& entry, const YAML::Node& node, const char* wanted) const {
    if (!node.IsScalar()) {
      failAt(entry.line, inQuotes(entry.key) + " must be " + wanted + ", not " + shown(node));
    }
    return node.Scalar();
  }

  double toNumber(const Entry& entry, const YAML::Node& node, Range range, const char* wanted) const {
    if (range.null_is_nan && node.IsNull()) return std::numeric_limits<double>::quiet_NaN();
    std::string text = scalar(entry, node, wanted);
    const bool quoted_in_file = node.Tag() == "!";
    if (!text.empty() && text.front() == '+') text.erase(0, 1);
    // YAML writes .nan and .inf; from_chars knows nan and inf.
    std::string plain = text;
    plain.erase(std::remove(plain.begin(), plain.end(), '.'), plain.end());
    std::transform(plain.begin(), plain.end(), plain.begin(),
                   [](unsigned char c) { return std::tolower(c); });
    const bool names_non_finite = plain == "nan" || plain == "inf" || plain == "-inf";
    double value = std::numeric_limits<double>::quiet_NaN();
    if (!names_non_finite) {
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
      const bool whole = end == text.data() + text.size();
      if (quoted_in_file || !whole || error == std::errc::invalid_argument) {
        failAt(entry.line, inQuotes(entry.key) + " must be " + wanted + ", not " + shown(node));
      }
      if (error == std::errc::result_out_of_range) value = std::numeric_limits<double>::infinity();
    }
    if (!std::isfinite(value)) {
      failAt(entry.line, inQuotes(entry.key) + " must be finite, not " + shown(node) +
                             " (allowed: " + allowed(range) + ")");
    }
    if (value < range.min || value > range.max) {
      failAt(entry.line, inQuotes(entry.key) + " is " + text + ", allowed: " + allowed(range));
    }
    return value;
  }

  int toInteger(const Entry& entry, Range range) const {
    // The range keeps the value inside int.
    range.min = std::max(range.min, -2147483648.0);
    range.max = std::min(range.max, 2147483647.0);
    const double value = toNumber(entry, entry.value, range, "a whole number");
    if (value != std::floor(value)) {
      failAt(entry.line, inQuotes(entry.key) + " must be a whole number, not " + shown(entry.value));
    }
    return static_cast<int>(value);
  }

  std::vector<double> toNumbers(const Entry& entry, std::size_t size, Range range) const {
    const std::string wanted =
        size == 0 ? "a list of numbers" : "a list of " + std::to_string(size) + " numbers";
    if (!entry.value.IsSequence() || (size != 0 && entry.value.size() != size)) {
      failAt(entry.line, inQuotes(entry.key) + " must be " + wanted + ", not " + shown(entry.value));
    }
    std::vector<double> values;
    for (const auto& item : entry.value) values.push_back(toNumber(entry, item, range, wanted.c_str()));
    return values;
  }

  std::size_t toChoice(const Entry& entry, const std::vector<std::string>& choices) const {
    const std::string& text = scalar(entry, entry.value, "a word");
    const auto found = std::find(choices.begin(), choices.end(), text);
    if (found != choices.end()) return static_cast<std::size_t>(found - choices.begin());
    failAt(entry.line, inQuotes(entry.key) + " is " + inQuotes(text) + ", allowed: " + joined(choices));
  }

  std::string pathOf(std::string_view key) const {
    return path.empty() ? std::string(key) : path + "." + std::string(key);
  }
};

ConfigReader::ConfigReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ConfigReader::~ConfigReader() = default;
ConfigReader::ConfigReader(ConfigReader&&) noexcept = default;
ConfigReader& ConfigReader::operator=(ConfigReader&&) noexcept = default;

ConfigReader ConfigReader::fromFile(const std::filesystem::path& file) {
  return fromText(readConfigText(file), file.string());
}

ConfigReader ConfigReader::fromText(const std::string& text, const std::string& origin) {
  YAML::Node node;
  try {
    node = YAML::Load(text);
  } catch (const YAML::Exception& error) {
    throw Error(ErrorKind::kInvalidConfig,
                origin + ":" + std::to_string(error.mark.line + 1) + ": not YAML: " + error.msg);
  }
  return ConfigReader(Impl::make(node, origin, "", 1));
}

bool ConfigReader::has(std::string_view key) const { return impl_->find(key) != nullptr; }

std::string ConfigReader::text(std::string_view key) const {
  const Impl::Entry& entry = impl_->need(key);
  return impl_->scalar(entry, entry.value, "a text");
}

std::string ConfigReader::text(std::string_view key, const std::string& fallback) const {
  return has(key) ? text(key) : fallback;
}

std::size_t ConfigReader::choice(std::string_view key, const std::vector<std::string>& choices) const {
  return impl_->toChoice(impl_->need(key), choices);
}

std::size_t ConfigReader::choice(std::string_view key, const std::vector<std::string>& choices,
                                 std::size_t fallback) const {
  return has(key) ? choice(key, choices) : fallback;
}

double ConfigReader::number(std::string_view key, Range range) const {
  const Impl::Entry& entry = impl_->need(key);
  return impl_->toNumber(entry, entry.value, range, "a number");
}

double ConfigReader::number(std::string_view key, Range range, double fallback) const {
  return has(key) ? number(key, range) : fallback;
}

int ConfigReader::integer(std::string_view key, Range range) const {
  return impl_->toInteger(impl_->need(key), range);
}

int ConfigReader::integer(std::string_view key, Range range, int fallback) const {
  return has(key) ? integer(key, range) : fallback;
}

bool ConfigReader::boolean(std::string_view key, bool fallback) const {
  const Impl::Entry* entry = impl_->find(key);
  if (entry == nullptr) return fallback;
  const std::string& text = impl_->scalar(*entry, entry->value, "true or false");
  if (text == "true") return true;
  if (text == "false") return false;
  impl_->failAt(entry->line, inQuotes(key) + " must be true or false, not " + inQuotes(text));
}

std::vector<double> ConfigReader::numbers(std::string_view key, std::size_t size, Range range) const {
  return impl_->toNumbers(impl_->need(key), size, range);
}

std::vector<double> ConfigReader::numbers(std::string_view key, std::size_t size, Range range,
                                          const std::vector<double>& fallback) const {
  return has(key) ? numbers(key, size, range) : fallback;
}

Eigen::Vector3d ConfigReader::vector3(std::string_view key, Range range) const {
  const std::vector<double> values = numbers(key, 3, range);
  return {values[0], values[1], values[2]};
}

Eigen::MatrixXd ConfigReader::matrix(std::string_view key, int rows, int cols, Range range) const {
  const Impl::Entry& entry = impl_->need(key);
  const std::string wanted =
      "a matrix of " + std::to_string(rows) + " rows of " + std::to_string(cols) + " numbers";
  const YAML::Node list = entry.value.IsMap() ? entry.value["data"] : entry.value;
  const auto refuse = [&] {
    impl_->failAt(entry.line, inQuotes(key) + " must be " + wanted + ", not " + shown(entry.value));
  };
  if (!list.IsDefined() || !list.IsSequence()) refuse();
  std::vector<double> values;
  for (const auto& item : list) {
    if (item.IsSequence() && item.size() == static_cast<std::size_t>(cols)) {
      for (const auto& number : item) values.push_back(impl_->toNumber(entry, number, range, wanted.c_str()));
    } else {
      values.push_back(impl_->toNumber(entry, item, range, wanted.c_str()));
    }
  }
  if (values.size() != static_cast<std::size_t>(rows * cols)) refuse();
  return Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      values.data(), rows, cols);
}

std::vector<std::string> ConfigReader::texts(std::string_view key) const {
  const Impl::Entry& entry = impl_->need(key);
  if (!entry.value.IsSequence()) {
    impl_->failAt(entry.line, inQuotes(key) + " must be a list of texts, not " + shown(entry.value));
  }
  std::vector<std::string> values;
  for (const auto& item : entry.value) values.push_back(impl_->scalar(entry, item, "a list of texts"));
  return values;
}

ConfigReader ConfigReader::section(std::string_view key) const {
  const Impl::Entry& entry = impl_->need(key);
  return ConfigReader(Impl::make(entry.value, impl_->origin, impl_->pathOf(key), entry.line));
}

std::optional<ConfigReader> ConfigReader::optionalSection(std::string_view key) const {
  if (!has(key)) return std::nullopt;
  return section(key);
}

std::vector<ConfigReader> ConfigReader::sections(std::string_view key) const {
  const Impl::Entry& entry = impl_->need(key);
  if (!entry.value.IsSequence()) {
    impl_->failAt(entry.line, inQuotes(key) + " must be a list of mappings, not " + shown(entry.value));
  }
  std::vector<ConfigReader> readers;
  for (const auto& item : entry.value) {
    const std::string path = impl_->pathOf(key) + "[" + std::to_string(readers.size()) + "]";
    readers.push_back(ConfigReader(Impl::make(item, impl_->origin, path, lineOf(item))));
  }
  return readers;
}

std::vector<std::string> ConfigReader::keys() const {
  std::vector<std::string> all;
  for (const Impl::Entry& entry : impl_->entries) all.push_back(entry.key);
  return all;
}

void ConfigReader::finish() const {
  for (const Impl::Entry& entry : impl_->entries) {
    if (impl_->known.count(entry.key) == 0) impl_->refuseUnknown(entry);
  }
}

void ConfigReader::fail(std::string_view key, const std::string& what) const {
  for (const Impl::Entry& entry : impl_->entries) {
    if (entry.key == key) impl_->failAt(entry.line, what);
  }
  impl_->failAt(impl_->line, what);
}

}  // namespace servocal
