// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sim_openni2_driver/served_cameras.h"

#include <dlfcn.h>

#include <filesystem>
#include <map>
#include <stdexcept>

#include "bus.h"
#include "servocal/core/error.h"

namespace servocal::sim_openni2_driver {
namespace {

/// The folder of the libOpenNI2 that this process has loaded, by the name it was found under: OpenNI2 looks
/// for its drivers below it.
std::filesystem::path libraryFolder() {
  Dl_info info;
  void* const symbol = dlsym(RTLD_DEFAULT, "oniInitialize");
  if (symbol == nullptr || dladdr(symbol, &info) == 0) {
    throw Error(ErrorKind::kHardwareAbsent,
                "This program was built without OpenNI2; the simulated cameras cannot be "
                "reached through it.");
  }
  return std::filesystem::path(info.dli_fname).parent_path();
}

Bus& findBus() {
  const std::filesystem::path driver = libraryFolder() / "OpenNI2" / "Drivers" / SERVOCAL_OPENNI2_PLUGIN;
  // libOpenNI2 opens the same file later, and gets the same copy of it.
  void* const plugin = dlopen(driver.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (plugin == nullptr) {
    throw Error(ErrorKind::kHardwareAbsent,
                "The OpenNI2 library of this process has no driver for simulated cameras (" +
                    driver.string() +
                    "). Start the program with LD_LIBRARY_PATH=" SERVOCAL_OPENNI2_ROOT
                    ", or give the cameras the backend 'sim'.");
  }
  const auto function = reinterpret_cast<BusFunction>(dlsym(plugin, "servocalOpenNi2Bus"));
  if (function == nullptr) {
    throw Error(ErrorKind::kHardwareAbsent, driver.string() + " is not the driver for simulated cameras.");
  }
  return *function();
}

}  // namespace

struct ServedCameras::Impl {
  Bus& bus = findBus();
  const Clock& clock;
  std::map<std::string, Served> cameras;

  explicit Impl(const Clock& run_clock) : clock(run_clock) {}
  const Served& find(const std::string& name) const {
    const auto found = cameras.find(name);
    if (found == cameras.end()) throw std::invalid_argument("ServedCameras: no camera '" + name + "'");
    return found->second;
  }
};

ServedCameras::ServedCameras(const Clock& clock, const std::vector<Served>& cameras)
    : impl_(std::make_unique<Impl>(clock)) {
  for (const Served& served : cameras) {
    const std::string& name = served.camera->info().name;
    impl_->cameras.emplace(name, served);
    plug(name);
  }
}

ServedCameras::~ServedCameras() {
  for (const auto& [name, served] : impl_->cameras) impl_->bus.unplug(uriOf(name));
}

void ServedCameras::unplug(const std::string& name) {
  (void)impl_->find(name);
  impl_->bus.unplug(uriOf(name));
}

void ServedCameras::plug(const std::string& name) {
  impl_->bus.plug(uriOf(name), impl_->find(name), impl_->clock);
}

}  // namespace servocal::sim_openni2_driver
