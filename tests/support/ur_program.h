// SPDX-License-Identifier: GPL-3.0-or-later
// A program with a Universal Robots arm on a terminal of its own. SERVOCAL_OPENNI2_ROOT says where our driver
// is.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "run_program.h"
#include "servocal/core/cell_config.h"
#include "terminal_program.h"

namespace servocal::test {

/// What the operator is asked, and what is to be typed then (tests/data/cells/ur_*.yaml).
inline constexpr char kUrPrompt[] = "let it move: ";
inline constexpr char kUrSerial[] = "2014350123\n";

inline std::string urCommand(const std::string& program, const std::filesystem::path& cell,
                             std::uint64_t seed, const std::filesystem::path& out,
                             const std::string& more = " --arm") {
  return "env LD_LIBRARY_PATH=" SERVOCAL_OPENNI2_ROOT " TERM=xterm NO_COLOR=1 " + program + " " +
         shellWord(cell.string()) + " --seed " + std::to_string(seed) + " --out " + shellWord(out.string()) +
         more;
}

/// The cell with its arm simulated directly: what a run behind the controller is compared with.
inline CellConfig withoutController(CellConfig cell) {
  cell.arm.backend = ArmBackend::kSim;
  return cell;
}

}  // namespace servocal::test
