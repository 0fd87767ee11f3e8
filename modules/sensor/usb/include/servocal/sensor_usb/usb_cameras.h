// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"

namespace servocal::usb {

/// A model of camera that we can read, by its USB numbers.
struct CameraModel {
  std::string name;           ///< "Kinect v2"; "UVC camera" for whatever says that it is a webcam.
  CameraBackend backend;      ///< The driver that reads it.
  bool needs_usb3 = false;    ///< Does not work below.
  bool kernel_reads = false;  ///< Through a kernel driver (uvcvideo); for all others one is in the way.
  double reserved_mbps =
      0.0;  ///< MB/s of the bus that it takes whatever it sends; 0: as many as its modes need.
  double color_bytes_per_px = 2.0;  ///< On the wire.
  double infrared_bytes_per_px = 1.5;
  int width_px = 640, height_px = 480;                    ///< Usual modes, if no cell file tells.
  int infrared_width_px = 640, infrared_height_px = 480;  ///< Infrared or depth; 0: none.
};

/// A camera on the USB.
struct Camera {
  CameraModel model;
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  int bus = 0;  ///< Cameras of one bus share its bandwidth.
  int address = 0;
  std::string port;           ///< "1-3.1": bus, then the port of each hub on the way.
  double speed_mbit = 0.0;    ///< 480: USB 2; 5000 and more: USB 3; 0: unknown.
  std::string serial;         ///< Empty if it has none.
  std::string kernel_driver;  ///< That holds its first interface; empty: none.
  bool may_open = true;       ///< This user may.
};

/// What is plugged in now, by bus and port. Without special rights; the cameras are not opened.
/// @throws Error (kHardwareAbsent) if the USB cannot be listed.
std::vector<Camera> cameras();

/// What keeps these cameras from working, one or two sentences each with the cure; empty: nothing known.
/// `cell` tells at which modes cameras run that it names by serial number; others run at their usual ones.
std::vector<std::string> problems(const std::vector<Camera>& cameras, const CellConfig* cell = nullptr);

/// "1-3.1", "USB 3 (5000 Mbit/s)", for tables.
std::string speedText(const Camera& camera);

/// Tells when a camera comes or goes.
class Watch {
 public:
  enum class Change { kCame, kWent };
  using Sink = std::function<void(Change, const Camera&)>;
  /// Cameras that are there already come first. @throws Error (kHardwareAbsent) if the system cannot tell.
  explicit Watch(Sink sink);
  ~Watch();
  /// Waits for changes up to this long (wall time) and calls the sink on this thread.
  void wait(std::chrono::milliseconds longest);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::usb
