// SPDX-License-Identifier: GPL-3.0-or-later
// What the program and the plug-in that libOpenNI2 loads into it share: one object of the plug-in.
#pragma once

#include <string>

#include "servocal/sim_openni2_driver/served_cameras.h"

namespace servocal::sim_openni2_driver {

class Bus {
 public:
  virtual ~Bus() = default;
  virtual void plug(const std::string& uri, const Served& served, const Clock& clock) = 0;
  virtual void unplug(const std::string& uri) = 0;
};

/// The plug-in's only C symbol beside OpenNI2's own: "servocalOpenNi2Bus".
using BusFunction = Bus* (*)();

}  // namespace servocal::sim_openni2_driver
