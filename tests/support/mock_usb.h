// SPDX-License-Identifier: GPL-3.0-or-later
// A mocked USB, in the words of umockdev.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

namespace servocal::test {

struct MockUsbDevice {
  int bus = 1;
  int address = 2;
  std::string port = "1-1";  ///< Name in sysfs; "usb1" for the bus itself.
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  int speed_mbit = 480;
  std::string serial;
  int interface_class = 0xff;  ///< 14: video.
};

/// The device as a block of an umockdev file.
inline std::string mockText(const MockUsbDevice& device) {
  const auto hex = [](const std::vector<int>& bytes) {
    std::string text;
    char two[4];
    for (const int byte : bytes) {
      std::snprintf(two, sizeof(two), "%02X", byte & 0xff);
      text += two;
    }
    return text;
  };
  const bool is_hub = device.port.rfind("usb", 0) == 0;
  const int usb = device.speed_mbit >= 5000 ? 3 : 2;
  const std::string descriptors =
      hex({18, 1, 0, usb, is_hub ? 9 : 0, 0, 0, usb == 3 ? 9 : 64, device.vendor_id, device.vendor_id >> 8,
           device.product_id, device.product_id >> 8, 0, 1, 0, 0, 0, 1}) +
      hex({9, 2, 18, 0, 1, 1, 0, 0xc0, 50}) +
      hex({9, 4, 0, 0, 0, is_hub ? 9 : device.interface_class, 0, 0, 0});
  char node[32], ids[32];
  std::snprintf(node, sizeof(node), "bus/usb/%03d/%03d", device.bus, device.address);
  std::snprintf(ids, sizeof(ids), "%04x\nA: idProduct=%04x\n", device.vendor_id, device.product_id);
  const std::string root = "/devices/pci0000:00/0000:00:14.0/usb" + std::to_string(device.bus);
  std::string text = "P: " + root + (is_hub ? "" : "/" + device.port) + "\n";
  text += std::string("N: ") + node + "=" + descriptors + "\n";
  text += std::string("E: DEVNAME=/dev/") + node + "\nE: DEVTYPE=usb_device\nE: MAJOR=189\nE: MINOR=" +
          std::to_string(128 * (device.bus - 1) + device.address - 1) + "\nE: SUBSYSTEM=usb\n";
  text += "A: bConfigurationValue=1\nA: busnum=" + std::to_string(device.bus) +
          "\nA: devnum=" + std::to_string(device.address) + "\nA: idVendor=" + ids +
          "A: speed=" + std::to_string(device.speed_mbit) + "\n";
  if (!device.serial.empty()) text += "A: serial=" + device.serial + "\n";
  return text + "H: descriptors=" + descriptors + "\n\n";
}

/// The bus itself, as its root hub.
inline std::string mockBus(int bus, int speed_mbit) {
  return mockText({bus, 1, "usb" + std::to_string(bus), 0x1d6b, 2, speed_mbit, "", 9});
}

}  // namespace servocal::test
