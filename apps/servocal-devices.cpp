// SPDX-License-Identifier: GPL-3.0-or-later
#include <csignal>
#include <iomanip>
#include <iostream>
#include <optional>

#include "servocal/app/main.h"
#include "servocal/core/cell_config.h"
#include "servocal/sensor_usb/usb_cameras.h"

namespace {

using namespace servocal;

volatile std::sig_atomic_t interrupted = 0;

const char* backendName(CameraBackend backend) {
  switch (backend) {
    case CameraBackend::kSim: return "sim";
    case CameraBackend::kOpenNi2: return "openni2";
    case CameraBackend::kFreenect: return "freenect";
    case CameraBackend::kV4l2: return "v4l2";
  }
  return "?";
}

void print(const std::vector<usb::Camera>& cameras) {
  std::cout << std::left << std::setw(34) << "camera" << std::setw(10) << "backend" << std::setw(5) << "bus"
            << std::setw(10) << "port" << std::setw(22) << "speed"
            << "serial\n";
  for (const usb::Camera& camera : cameras) {
    std::cout << std::setw(34) << camera.model.name << std::setw(10) << backendName(camera.model.backend)
              << std::setw(5) << camera.bus << std::setw(10) << camera.port << std::setw(22)
              << usb::speedText(camera) << (camera.serial.empty() ? "-" : camera.serial) << '\n';
  }
}

void watch() {
  std::cerr << "Watching; Ctrl-C ends.\n";
  usb::Watch changes([](usb::Watch::Change change, const usb::Camera& camera) {
    std::cout << (change == usb::Watch::Change::kCame ? "+ " : "- ") << camera.model.name << " at port "
              << camera.port << ", " << usb::speedText(camera)
              << (camera.serial.empty() ? "" : ", serial " + camera.serial)
              << std::endl;  // Whoever reads this through a pipe wants it now.
  });
  while (interrupted == 0) changes.wait(std::chrono::milliseconds(200));
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Lists the cameras on the USB and says what keeps them from working. Moves no robot.",
               "servocal-devices");
  std::string cell_file;
  bool keep_watching = false;
  cli.add_option("CELL", cell_file,
                 "Cell file: judge the bandwidth by its modes; else by every camera's usual ones");
  cli.add_flag("--watch", keep_watching, "Go on and tell who is plugged in (+) and out (-)");
  cli.footer(
      "Example:\n"
      "  $ servocal-devices\n"
      "  camera                            backend   bus  port      speed                 serial\n"
      "  Kinect v2                         openni2   1    1-2       USB 2, 480 Mbit/s     012345643247\n"
      "  Kinect v1                         freenect  1    1-3.1     USB 2, 480 Mbit/s     A00362A01385118A\n"
      "  Kinect v2 012345643247 at port 1-2 hangs on USB 2 (USB 2, 480 Mbit/s) and sends nothing there. "
      "Plug it into a USB 3 port (blue), without a hub or extension.\n"
      "Exit code 4: a camera will not work as it is; 5: there is none.\n");
  return app::guardedMain(cli, argc, argv, [&] {
    std::optional<CellConfig> cell;
    if (!cell_file.empty()) cell = loadCell(cell_file);
    if (keep_watching) {
      for (const int signal : {SIGINT, SIGTERM}) std::signal(signal, [](int) { interrupted = 1; });
      watch();
      return static_cast<int>(app::kOk);
    }
    const std::vector<usb::Camera> cameras = usb::cameras();
    if (cameras.empty()) {
      std::cout << "No camera that servocal knows is on the USB.\n";
      return static_cast<int>(app::kHardwareAbsent);
    }
    print(cameras);
    const auto problems = usb::problems(cameras, cell ? &*cell : nullptr);
    for (const std::string& problem : problems) std::cout << problem << '\n';
    return static_cast<int>(problems.empty() ? app::kOk : app::kGoalNotMet);
  });
}
