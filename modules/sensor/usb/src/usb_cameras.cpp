// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor_usb/usb_cameras.h"

#include <libusb.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <map>
#include <optional>
#include <tuple>

#include "models.h"
#include "servocal/core/error.h"

namespace servocal::usb {
namespace {

constexpr int kDeepest = 7;  // hubs in a row, says the standard

[[noreturn]] void refuse(const std::string& what, int code) {
  throw Error(ErrorKind::kHardwareAbsent, what + ": " + libusb_strerror(code) + ".");
}

struct Context {
  libusb_context* raw = nullptr;
  Context() {
    if (const int code = libusb_init(&raw); code != LIBUSB_SUCCESS) refuse("The USB cannot be listed", code);
  }
  ~Context() { libusb_exit(raw); }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;
};

std::string portOf(libusb_device* device) {
  std::array<std::uint8_t, kDeepest> ports{};
  const int count = libusb_get_port_numbers(device, ports.data(), kDeepest);
  std::string path = std::to_string(libusb_get_bus_number(device));
  for (int i = 0; i < count; ++i)
    path += (i == 0 ? "-" : ".") + std::to_string(ports[static_cast<std::size_t>(i)]);
  return path;
}

double speedOf(libusb_device* device) {
  switch (libusb_get_device_speed(device)) {
    case LIBUSB_SPEED_LOW: return 1.5;
    case LIBUSB_SPEED_FULL: return 12.0;
    case LIBUSB_SPEED_HIGH: return 480.0;
    case LIBUSB_SPEED_SUPER: return 5000.0;
    case LIBUSB_SPEED_SUPER_PLUS: return 10000.0;
    default: return 0.0;
  }
}

/// Interfaces say what they are; webcams are known by that alone.
bool isWebcam(libusb_device* device) {
  libusb_config_descriptor* config = nullptr;
  if (libusb_get_config_descriptor(device, 0, &config) != LIBUSB_SUCCESS) return false;
  bool video = false;
  for (int i = 0; i < config->bNumInterfaces; ++i) {
    const libusb_interface& interface = config->interface[i];
    if (interface.num_altsetting > 0) video |= interface.altsetting[0].bInterfaceClass == LIBUSB_CLASS_VIDEO;
  }
  libusb_free_config_descriptor(config);
  return video;
}

/// The kernel knows the strings; asking the device itself would need rights.
std::string attribute(const std::string& port, const std::string& name) {
  std::ifstream file("/sys/bus/usb/devices/" + port + "/" + name);
  std::string line;
  std::getline(file, line);
  return line;
}

std::string kernelDriver(const std::string& port) {
  std::array<char, 256> target{};
  const std::string link = "/sys/bus/usb/devices/" + port + ":1.0/driver";
  const ssize_t size = readlink(link.c_str(), target.data(), target.size() - 1);
  if (size <= 0) return {};
  const std::string path(target.data(), static_cast<std::size_t>(size));
  return path.substr(path.rfind('/') + 1);
}

bool mayOpen(int bus, int address) {
  std::array<char, 32> node{};
  std::snprintf(node.data(), node.size(), "/dev/bus/usb/%03d/%03d", bus, address);
  return access(node.data(), R_OK | W_OK) == 0;
}

std::optional<Camera> describe(libusb_device* device) {
  libusb_device_descriptor descriptor{};
  if (libusb_get_device_descriptor(device, &descriptor) != LIBUSB_SUCCESS) return std::nullopt;
  Camera camera;
  if (const auto model = knownModel(descriptor.idVendor, descriptor.idProduct))
    camera.model = *model;
  else if (isWebcam(device))
    camera.model = webcam();
  else
    return std::nullopt;
  camera.vendor_id = descriptor.idVendor;
  camera.product_id = descriptor.idProduct;
  camera.bus = libusb_get_bus_number(device);
  camera.address = libusb_get_device_address(device);
  camera.port = portOf(device);
  camera.speed_mbit = speedOf(device);
  camera.serial = attribute(camera.port, "serial");
  camera.kernel_driver = kernelDriver(camera.port);
  camera.may_open = mayOpen(camera.bus, camera.address);
  return camera;
}

}  // namespace

std::vector<Camera> cameras() {
  const Context context;
  libusb_device** list = nullptr;
  const ssize_t count = libusb_get_device_list(context.raw, &list);
  if (count < 0) refuse("The USB cannot be listed", static_cast<int>(count));
  std::vector<Camera> found;
  for (ssize_t i = 0; i < count; ++i) {
    if (auto camera = describe(list[i])) found.push_back(*std::move(camera));
  }
  libusb_free_device_list(list, 1);
  std::sort(found.begin(), found.end(), [](const Camera& a, const Camera& b) {
    return std::tie(a.bus, a.port) < std::tie(b.bus, b.port);
  });
  return found;
}

struct Watch::Impl {
  Context context;
  Sink sink;
  std::map<libusb_device*, Camera> present;  // Who went away can no longer be asked.

  static int LIBUSB_CALL changed(libusb_context*, libusb_device* device, libusb_hotplug_event event,
                                 void* self) {
    static_cast<Impl*>(self)->change(device, event == LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED);
    return 0;
  }

  void change(libusb_device* device, bool came) {
    if (came) {
      if (auto camera = describe(device)) {
        present[device] = *camera;
        sink(Change::kCame, *camera);
      }
    } else if (const auto gone = present.find(device); gone != present.end()) {
      const Camera camera = gone->second;
      present.erase(gone);
      sink(Change::kWent, camera);
    }
  }
};

Watch::Watch(Sink sink) : impl_(std::make_unique<Impl>()) {
  impl_->sink = std::move(sink);
  if (libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) == 0) {
    throw Error(ErrorKind::kHardwareAbsent, "This system does not tell when USB devices come and go.");
  }
  const int code = libusb_hotplug_register_callback(
      impl_->context.raw, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED | LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT,
      LIBUSB_HOTPLUG_ENUMERATE, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY,
      &Impl::changed, impl_.get(), nullptr);
  if (code != LIBUSB_SUCCESS) refuse("The USB cannot be watched", code);
}

Watch::~Watch() = default;

void Watch::wait(std::chrono::milliseconds longest) {
  timeval time{};
  time.tv_sec = longest.count() / 1000;
  time.tv_usec = 1000 * (longest.count() % 1000);
  libusb_handle_events_timeout_completed(impl_->context.raw, &time, nullptr);
}

}  // namespace servocal::usb
