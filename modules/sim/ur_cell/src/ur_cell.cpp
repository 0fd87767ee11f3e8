// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sim_ur_cell/ur_cell.h"

#include <stdexcept>

#include "controller_process.h"
#include "servocal/core/error.h"

namespace servocal::sim {
namespace {

const CellConfig& checked(const CellConfig& config) {
  if (!config.simulation || !config.arm.ur)
    throw std::invalid_argument(
        "sim::UrCell: the cell has no simulation section, or its arm is not of the backend 'ur'");
  if (config.arm.urdf != "ur5") {
    throw Error(
        ErrorKind::kInvalidConfig,
        "The simulated controller has a UR5 and no other arm: leave out 'urdf', or use the backend 'sim'.");
  }
  return config;
}

}  // namespace

struct UrCell::Impl {
  Impl(const CellConfig& config, std::uint64_t seed, Clock& clock)
      : controller(checked(config).arm, seed), motion(controller.record(), clock),
        cell(config, seed, clock, motion) {}

  ControllerProcess controller;
  RecordedMotion motion;
  Cell cell;
};

UrCell::UrCell(const CellConfig& config, std::uint64_t seed, Clock& clock)
    : impl_(std::make_unique<Impl>(config, seed, clock)) {}
UrCell::~UrCell() = default;

Cell& UrCell::cell() { return impl_->cell; }
const UrConfig& UrCell::address() const { return impl_->controller.address(); }

}  // namespace servocal::sim
