// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "servocal/core/pose.h"

namespace servocal {

/// Inclusive range of allowed values.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool null_is_nan = false;  ///< A null is allowed and read as not-a-number.
};

/// One mapping of a YAML (or JSON) file, read strictly: every mistake is an Error (kInvalidConfig) with
/// file and line; finish() refuses keys that nobody asked for and names the nearest valid one.
///
/// Getters without a default demand the key. All values must be finite and inside `range` (or null, where the range says so).
class ConfigReader {
 public:
  /// @throws Error (kInvalidConfig) if the file cannot be read or is not a YAML mapping.
  static ConfigReader fromFile(const std::filesystem::path& file);
  /// `origin` names the text in messages.
  static ConfigReader fromText(const std::string& text, const std::string& origin);
  ~ConfigReader();
  ConfigReader(ConfigReader&&) noexcept;
  ConfigReader& operator=(ConfigReader&&) noexcept;

  bool has(std::string_view key) const;  ///< Also marks the key as known.
  std::string text(std::string_view key) const;
  std::string text(std::string_view key, const std::string& fallback) const;
  /// One of `choices`; returns its index.
  std::size_t choice(std::string_view key, const std::vector<std::string>& choices) const;
  std::size_t choice(std::string_view key, const std::vector<std::string>& choices,
                     std::size_t fallback) const;
  double number(std::string_view key, Range range) const;
  double number(std::string_view key, Range range, double fallback) const;
  int integer(std::string_view key, Range range) const;
  int integer(std::string_view key, Range range, int fallback) const;
  bool boolean(std::string_view key, bool fallback) const;
  /// A list of `size` numbers (any number if size is 0).
  std::vector<double> numbers(std::string_view key, std::size_t size, Range range) const;
  std::vector<double> numbers(std::string_view key, std::size_t size, Range range,
                              const std::vector<double>& fallback) const;
  Eigen::Vector3d vector3(std::string_view key, Range range) const;
  /// A matrix as a list of rows, a flat list row by row, or OpenCV's and ROS' {rows, cols, data}.
  Eigen::MatrixXd matrix(std::string_view key, int rows, int cols, Range range) const;
  std::vector<std::string> texts(std::string_view key) const;
  /// A nested mapping; call finish() on it too.
  ConfigReader section(std::string_view key) const;
  std::optional<ConfigReader> optionalSection(std::string_view key) const;
  /// A list of mappings.
  std::vector<ConfigReader> sections(std::string_view key) const;
  std::vector<std::string> keys() const;

  /// Refuses keys that no getter asked for.
  void finish() const;
  /// An Error (kInvalidConfig) that points to `key`'s line (or this mapping's), for checks of the caller.
  [[noreturn]] void fail(std::string_view key, const std::string& what) const;

 private:
  struct Impl;
  explicit ConfigReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal
