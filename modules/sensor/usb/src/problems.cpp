// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cstdio>
#include <map>

#include "servocal/sensor_usb/usb_cameras.h"

namespace servocal::usb {
namespace {

// What isochronous transfers may fill of a bus (80 % of USB 2), less what its protocol takes.
constexpr double kUsb2Mbps = 40.0, kUsb3Mbps = 400.0;
constexpr double kRateHz = 30.0;

bool isUsb3(const Camera& camera) { return camera.speed_mbit >= 5000.0; }

std::string named(const Camera& camera) {
  return camera.model.name + (camera.serial.empty() ? "" : " " + camera.serial) + " at port " + camera.port;
}

std::string hex(std::uint16_t number) {
  char text[8];
  std::snprintf(text, sizeof(text), "%04x", number);
  return text;
}

std::string permission(const Camera& camera) {
  return named(camera) +
         ": this user may not open it. As root, write the line\n    SUBSYSTEM==\"usb\", "
         "ATTR{idVendor}==\"" +
         hex(camera.vendor_id) + "\", ATTR{idProduct}==\"" + hex(camera.product_id) +
         "\", MODE=\"0660\", TAG+=\"uaccess\"\n  into /etc/udev/rules.d/60-servocal-cameras.rules, run "
         "'udevadm control "
         "--reload', and plug the camera in again.";
}

/// MB/s on the wire.
double demand(const Camera& camera, const CellConfig* cell) {
  const CameraModel& model = camera.model;
  if (model.reserved_mbps > 0.0) return model.reserved_mbps;
  double color_px = 1.0 * model.width_px * model.height_px;
  double infrared_px = 1.0 * model.infrared_width_px * model.infrared_height_px;
  bool take_turns = false;
  if (cell != nullptr && !camera.serial.empty()) {
    for (const CameraConfig& config : cell->cameras) {
      if (config.device != camera.serial) continue;
      color_px = 1.0 * config.width_px * config.height_px;
      infrared_px = config.infrared ? 1.0 * config.infrared->width_px * config.infrared->height_px : 0.0;
      take_turns = config.infrared && config.infrared->excludes_color;
    }
  }
  const double color = 1e-6 * kRateHz * color_px * model.color_bytes_per_px;
  const double infrared = 1e-6 * kRateHz * infrared_px * model.infrared_bytes_per_px;
  return take_turns ? std::max(color, infrared) : color + infrared;
}

std::string crowded(const std::vector<const Camera*>& on_bus, double need_mbps, double room_mbps) {
  std::string who;
  for (const Camera* camera : on_bus) who += (who.empty() ? "" : ", ") + named(*camera);
  char numbers[80];
  std::snprintf(numbers, sizeof(numbers), "%.0f MB/s of about %.0f", need_mbps, room_mbps);
  return who + (on_bus.size() > 1 ? " share a bus and" : "") + " need " + numbers +
         (on_bus.size() > 1
              ? ": frames will be lost. Plug one of them into another controller (an add-in card; another "
                "port of the same computer is often the same bus), or let them take turns."
              : ": frames will be lost. Choose smaller images, or a USB 3 port.");
}

}  // namespace

std::string speedText(const Camera& camera) {
  if (camera.speed_mbit <= 0.0) return "speed unknown";
  char text[48];
  std::snprintf(text, sizeof(text), "USB %s, %.0f Mbit/s",
                isUsb3(camera)              ? "3"
                : camera.speed_mbit > 400.0 ? "2"
                                            : "1",
                camera.speed_mbit);
  return text;
}

std::vector<std::string> problems(const std::vector<Camera>& cameras, const CellConfig* cell) {
  std::vector<std::string> found;
  std::map<int, std::vector<const Camera*>> buses;
  for (const Camera& camera : cameras) {
    const CameraModel& model = camera.model;
    const bool too_slow = model.needs_usb3 && camera.speed_mbit > 0.0 && !isUsb3(camera);
    if (too_slow) {
      found.push_back(
          named(camera) + " hangs on USB 2 (" + speedText(camera) +
          ") and sends nothing there. Plug it into a USB 3 port (blue), without a hub or extension.");
    } else {
      buses[camera.bus].push_back(&camera);
    }
    if (!camera.may_open && !model.kernel_reads) found.push_back(permission(camera));
    if (!model.kernel_reads && !camera.kernel_driver.empty() && camera.kernel_driver != "usbfs") {
      found.push_back(named(camera) + ": the kernel's driver " + camera.kernel_driver +
                      " has it. As root: 'modprobe -r " + camera.kernel_driver + "', and 'echo blacklist " +
                      camera.kernel_driver + " > /etc/modprobe.d/servocal-cameras.conf' to keep it away.");
    }
    if (model.kernel_reads && camera.kernel_driver.empty()) {
      found.push_back(named(camera) +
                      ": no kernel driver has it, so it has no /dev/video. As root: 'modprobe uvcvideo'.");
    }
  }
  for (const auto& [bus, on_bus] : buses) {
    double need_mbps = 0.0;
    for (const Camera* camera : on_bus) need_mbps += demand(*camera, cell);
    const bool usb3 =
        std::any_of(on_bus.begin(), on_bus.end(), [](const Camera* camera) { return isUsb3(*camera); });
    const double room_mbps = usb3 ? kUsb3Mbps : kUsb2Mbps;
    // A webcam alone picks its own compression.
    const bool picks_itself = on_bus.size() == 1 && on_bus.front()->model.kernel_reads;
    if (need_mbps > room_mbps && !picks_itself) found.push_back(crowded(on_bus, need_mbps, room_mbps));
  }
  return found;
}

}  // namespace servocal::usb
