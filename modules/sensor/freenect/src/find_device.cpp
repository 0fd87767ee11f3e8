// SPDX-License-Identifier: GPL-3.0-or-later
#include "find_device.h"

#include <algorithm>
#include <vector>

#include "kinect.h"
#include "servocal/core/error.h"
#include "servocal/sensor_usb/usb_cameras.h"

namespace servocal::freenect {
namespace {

/// What is on the USB although libfreenect cannot read its serial number.
std::string unread(const std::vector<std::string>& read) {
  std::string text;
  try {
    for (const usb::Camera& camera : usb::cameras()) {
      if (camera.model.name != "Kinect v1" ||
          std::find(read.begin(), read.end(), camera.serial) != read.end())
        continue;
      text += " A Kinect v1 " + camera.serial + " is plugged in (port " + camera.port +
              (camera.may_open ? "), but does not answer: plug it in again, with its power supply; "
                               : "), but this user may not open it; ") +
              "servocal-devices says more.";
    }
  } catch (const Error&) {  // A hint is not worth another error.
  }
  return text;
}

std::vector<std::string> plugged() {
  const Context context;
  return context.serials();
}

}  // namespace

bool isPlugged(const std::string& serial) {
  const std::vector<std::string> all = plugged();
  return std::find(all.begin(), all.end(), serial) != all.end();
}

std::string findDevice(const CameraConfig& config) {
  const auto absent = [&](const std::string& what) -> std::string {
    throw Error(ErrorKind::kHardwareAbsent, "Camera '" + config.name + "': " + what);
  };
  const std::vector<std::string> all = plugged();
  if (all.empty()) {
    return absent("no Kinect v1 is plugged in that libfreenect can open. It needs its own power supply too." +
                  unread(all));
  }
  std::string list;
  for (std::size_t i = 0; i < all.size(); ++i)
    list += (i > 0 ? ", " : "") + all[i] + " (number " + std::to_string(i) + ")";
  const std::string& device = config.device;
  if (device.empty()) {
    if (all.size() == 1) return all.front();
    return absent("several Kinects v1 are plugged in; name one by 'device' in the cell file: " + list + ".");
  }
  if (std::find(all.begin(), all.end(), device) != all.end()) return device;
  const bool is_number = device.size() <= 2 && device.find_first_not_of("0123456789") == std::string::npos;
  if (is_number && std::stoul(device) < all.size()) return all[std::stoul(device)];
  return absent("there is no Kinect v1 '" + device + "'. Plugged in: " + list + "." + unread(all));
}

}  // namespace servocal::freenect
