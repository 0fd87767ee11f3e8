// SPDX-License-Identifier: GPL-3.0-or-later
#include "find_device.h"

#include <algorithm>

#include "servocal/core/error.h"
#include "servocal/sensor_usb/usb_cameras.h"

namespace servocal::openni2 {
namespace {

/// What is on the USB although OpenNI2 does not see it.
std::string withoutDriver(const std::vector<Device>& seen) {
  std::string text;
  std::vector<usb::Camera> plugged;
  try {
    plugged = usb::cameras();
  } catch (const Error&) {
    return text;  // A hint is not worth another error.
  }
  for (const usb::Camera& camera : plugged) {
    const bool is_seen = std::any_of(seen.begin(), seen.end(), [&](const Device& device) {
      return !camera.serial.empty() && device.serial == camera.serial;
    });
    if (is_seen) continue;
    const std::string name = camera.model.name + (camera.serial.empty() ? "" : " " + camera.serial);
    if (camera.model.name == "Kinect v2") {
      text += " A " + name + " is plugged in (port " + camera.port +
              "), but OpenNI2 has no driver for it: Debian has none; docs/cameras.md says how to build it.";
    } else if (camera.model.name == "Kinect v1") {
      text += " A " + name + " is plugged in (port " + camera.port +
              "), but OpenNI2 has no driver for it here: say 'backend: freenect' in the cell file.";
    } else if (camera.model.backend == CameraBackend::kOpenNi2 && !camera.may_open) {
      text += " A " + name + " is plugged in (port " + camera.port +
              "), but this user may not open it: servocal-devices says which udev rule helps.";
    }
  }
  return text;
}

}  // namespace

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
    throw Error(ErrorKind::kHardwareAbsent, camera + "OpenNI2 sees no device." + withoutDriver(devices));
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
  throw Error(ErrorKind::kHardwareAbsent, camera + "OpenNI2 sees no device '" + config.device +
                                              "'. It sees: " + list + "." + withoutDriver(devices));
}

}  // namespace servocal::openni2
