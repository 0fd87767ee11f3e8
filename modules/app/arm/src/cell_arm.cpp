// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app_arm/cell_arm.h"

#include <cstdio>
#include <optional>

#include "consent.h"
#include "servocal/core/error.h"
#include "servocal/robot_ur/arm.h"
#include "servocal/robot_ur/consent.h"
#include "servocal/sim_ur_cell/ur_cell.h"

namespace servocal::app {
namespace {

using robot::ur::ControllerFacts;
using robot::ur::LinkReport;

bool isThisComputer(const std::string& host) {
  return host == "localhost" || host == "::1" || host.rfind("127.", 0) == 0;
}

bool hasSimulatedController(const CellConfig& cell) {
  return cell.arm.backend == ArmBackend::kUr && cell.simulation && isThisComputer(cell.arm.ur->host);
}

/// The simulated controller runs on this very computer: what is busy must not look dead.
robot::ur::ArmOptions patient() {
  robot::ur::ArmOptions options;
  options.watchdog = std::chrono::milliseconds(300);
  options.dead_peer = std::chrono::milliseconds(300);
  options.reply_timeout = std::chrono::seconds(5);
  return options;
}

template <class... Values>
std::string formatted(const char* format, Values... values) {
  char text[400];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

std::string lineOf(const ControllerFacts& facts) {
  const Eigen::Vector3d tcp_mm = 1e3 * facts.eMtcp.translation();
  return formatted(
      "%s %s at %s, PolyScope %s, %.0f Hz, active TCP %.2f %.2f %.2f mm on the flange, payload %.3f kg",
      facts.model.c_str(), facts.serial.c_str(), facts.address.c_str(), facts.polyscope.c_str(),
      facts.rate_hz, tcp_mm.x(), tcp_mm.y(), tcp_mm.z(), facts.payload_kg);
}

std::string lineOf(const LinkReport& report) {
  return formatted(
      "%zu packages, %zu missed, %zu repeated, longest gap %.1f ms; speed slider %.0f to %.0f %%; safety "
      "mode "
      "%d, robot mode %d at the end",
      report.states, report.missed, report.repeated, 1e3 * toSeconds(report.longest_gap),
      100.0 * report.speed_slider_min, 100.0 * report.speed_slider_max, report.safety_mode,
      report.robot_mode);
}

void demandPermission(const CellConfig& cell, const ArmOptions& options) {
  if (cell.arm.backend == ArmBackend::kSim) {
    if (!options.arm) return;
    throw Error(
        ErrorKind::kNothingToDo,
        "--arm is for real arms; this cell's arm is simulated (arm: backend: sim) and needs no consent.");
  }
  if (!options.arm) {
    throw Error(ErrorKind::kRefusedToMove,
                "The cell's arm is a real one, at " + cell.arm.ur->host +
                    ". It moves only with --arm and after its serial number was typed; "
                    "--dry-run shows what it would do.");
  }
  demandTerminal();
}

}  // namespace

struct CellArm::Impl {
  Impl(const CellConfig& cell_config, std::uint64_t cell_seed) : cell(cell_config), seed(cell_seed) {
    if (cell.arm.backend == ArmBackend::kSim) {
      simulated.emplace(cell, seed);
      return;
    }
    wall.emplace();
    ArmConfig config = cell.arm;
    if (hasSimulatedController(cell)) {
      controller.emplace(cell, seed, *wall);
      config.ur = controller->address();
      notes.push_back(
          "the arm and its controller are simulated, in real time; consent is asked for as if they were not");
    } else if (cell.simulation) {
      notes.push_back("the arm is a real one; the cell file's simulation section does not count");
    }
    ur.emplace(config, cell.limits, *wall, controller ? patient() : robot::ur::ArmOptions());
    if (!controller) {
      notes.push_back(
          "not run on a real Universal Robots arm: this driver is tested against a simulated controller "
          "only (docs/universal-robots.md); stay at the emergency stop");
    }
  }

  CellConfig cell;
  std::uint64_t seed;
  std::optional<sim::Cell> simulated;
  std::optional<WallClock> wall;
  std::optional<sim::UrCell> controller;
  std::optional<robot::ur::Arm> ur;
  std::vector<std::string> notes;
};

CellArm::CellArm(const CellConfig& cell, const ArmOptions& options) {
  demandPermission(cell, options);
  impl_ = std::make_unique<Impl>(cell, options.seed);
}

CellArm::~CellArm() = default;

Clock& CellArm::clock() {
  if (impl_->wall) return *impl_->wall;
  return impl_->simulated->clock();
}

robot::Arm& CellArm::device() {
  if (impl_->ur) return *impl_->ur;
  return impl_->simulated->arm();
}

sim::Cell* CellArm::simulation() {
  if (impl_->simulated) return &*impl_->simulated;
  return impl_->controller ? &impl_->controller->cell() : nullptr;
}

void CellArm::askConsent() {
  if (!impl_->ur) return;
  const std::string simulated =
      impl_->controller ? "Simulated controller: nothing real moves. With a real arm you would read this:\n\n"
                        : "";
  impl_->ur->arm(
      askAtTerminal("\n" + simulated + robot::ur::consentText(impl_->ur->facts(), impl_->cell.limits)));
}

std::string CellArm::provenance() const {
  std::string text = impl_->ur && !impl_->controller ? "cell '" : "simulated cell '";
  text += impl_->cell.name + "'";
  if (impl_->ur) {
    const ControllerFacts& facts = impl_->ur->facts();
    text += ", " + std::string(impl_->controller ? "simulated " : "") + facts.model + " " + facts.serial +
            " at " + facts.address;
  }
  if (!impl_->ur || impl_->controller) text += ", seed " + std::to_string(impl_->seed);
  return text;
}

const std::vector<std::string>& CellArm::notes() const { return impl_->notes; }

std::vector<std::string> CellArm::record() const {
  if (!impl_->ur) return {};
  const LinkReport report = impl_->ur->report();
  std::vector<std::string> lines = {lineOf(impl_->ur->facts()), lineOf(report)};
  for (const std::string& message : report.messages) lines.push_back("the controller says: " + message);
  return lines;
}

}  // namespace servocal::app
