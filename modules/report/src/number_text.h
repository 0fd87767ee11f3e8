// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <string>

namespace servocal::report {

/// 17 significant digits, so it reads back identically, and with a decimal point, so that YAML 1.1 readers do
/// not take "1e-05" for a word.
std::string number(double value);

/// The entries row by row: "1.0, 0.0, 0.5".
std::string numbers(const Eigen::MatrixXd& values, const std::string& separator = ", ");

/// Few digits, for sentences: "0.0123".
std::string shortNumber(double value);

}  // namespace servocal::report
