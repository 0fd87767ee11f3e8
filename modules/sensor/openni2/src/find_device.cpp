// SPDX-License-Identifier: GPL-3.0-or-later
#include "find_device.h"

#include "servocal/core/error.h"

namespace servocal::openni2 {

std::string describe(const Device& device) {
  std::string text = device.vendor.empty() ? device.name : device.vendor + " " + device.name;
  if (!device.serial.empty()) text += ", serial " + device.serial;
  return text + ", " + device.uri;
}

Device findDevice(const Library& library, const CameraConfig& config) {
  const std::vector<Device> devices = library.devices();
  const std::string camera = "Camera '" + config.name + "': ";
  std::string list;
  for (const Device& device : devices) list += (list.empty() ? "" : "; ") + describe(device);
  if (devices.empty()) {
    throw Error(ErrorKind::kHardwareAbsent, camera + "OpenNI2 sees no device.");
  }
  if (config.device.empty()) {
    if (devices.size() == 1) return devices.front();
    throw Error(
        ErrorKind::kHardwareAbsent,
        camera + "OpenNI2 sees several devices; name one by 'device' in the cell file: " + list + ".");
  }
  for (const Device& device : devices) {
    if (device.serial == config.device || device.uri == config.device) return device;
  }
  throw Error(ErrorKind::kHardwareAbsent,
              camera + "OpenNI2 sees no device '" + config.device + "'. It sees: " + list + ".");
}

}  // namespace servocal::openni2
