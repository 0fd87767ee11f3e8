// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <OpenNI.h>

#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "servocal/sensor_openni2/camera.h"

namespace servocal::openni2 {

/// OpenNI2, started for as long as somebody uses it, and what is plugged in.
class Library final : openni::OpenNI::DeviceConnectedListener, openni::OpenNI::DeviceDisconnectedListener {
 public:
  /// The one of this process. @throws Error (kHardwareAbsent) if OpenNI2 does not start.
  static std::shared_ptr<Library> instance();
  Library();
  ~Library();

  bool isPlugged(const std::string& uri) const;
  std::vector<Device> devices() const;

 private:
  void onDeviceConnected(const openni::DeviceInfo* info) override;
  void onDeviceDisconnected(const openni::DeviceInfo* info) override;

  mutable std::mutex mutex_;  // Drivers call the listeners from threads of their own.
  std::set<std::string> plugged_;
};

/// What OpenNI2 says of its last failure, as one line.
std::string lastError();

}  // namespace servocal::openni2
