// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace servocal::session {

/// The same tree as block YAML; lists of numbers on one line, every number such that it reads back
/// identically (also in YAML 1.1 readers, which take 1e-05 for a text), non-finite ones as null.
std::string toYaml(const nlohmann::ordered_json& tree);

}  // namespace servocal::session
