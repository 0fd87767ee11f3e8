// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app_cameras/cameras.h"

#include <optional>
#include <utility>

#include "servocal/core/error.h"
#include "servocal/sensor_freenect/camera.h"
#include "servocal/sensor_openni2/camera.h"
#include "servocal/sensor_v4l2/camera.h"
#include "servocal/sim_openni2_driver/served_cameras.h"

namespace servocal::app {
namespace {

[[noreturn]] void refuse(const CameraConfig& camera, const std::string& why) {
  throw Error(ErrorKind::kInvalidConfig, "Camera '" + camera.name + "': " + why);
}

void demandRealCell(const CameraConfig& camera, const std::string& backend, const sim::Cell* simulation) {
  if (simulation != nullptr)
    refuse(camera, "the backend '" + backend +
                       "' reads real cameras only; in a simulated cell use 'sim' or 'openni2'.");
}

}  // namespace

struct Cameras::Impl {
  std::optional<sim_openni2_driver::ServedCameras> served;  // Must go last: open cameras use it.
  std::vector<std::unique_ptr<sensor::RgbdCamera>> own;
  std::vector<sensor::RgbdCamera*> all;
  std::vector<std::string> notes;

  void serve(const CellConfig& cell, sim::Cell& simulation) {
    std::vector<sim_openni2_driver::Served> devices;
    for (const CameraConfig& camera : cell.cameras) {
      if (camera.backend == CameraBackend::kOpenNi2) devices.push_back({&simulation.camera(camera.name)});
    }
    if (!devices.empty()) served.emplace(simulation.clock(), devices);
  }

  void openOpenNi2(CameraConfig camera, Clock& clock, bool simulated, const CameraOptions& options) {
    if (simulated) camera.device = sim_openni2_driver::uriOf(camera.name);
    openni2::OpenOptions how;
    how.lock_exposure = options.lock_exposure;
    how.record = options.record;
    keep(camera.name, openni2::openCamera(camera, clock, how));
  }

  void openFreenect(const CameraConfig& camera, Clock& clock, const CameraOptions& options) {
    freenect::OpenOptions how;
    how.lock_exposure = options.lock_exposure;
    keep(camera.name, freenect::openCamera(camera, clock, how));
  }

  void openV4l2(const CameraConfig& camera, Clock& clock, const CameraOptions& options) {
    v4l2::OpenOptions how;
    how.lock_exposure = options.lock_exposure;
    keep(camera.name, v4l2::openCamera(camera, clock, how));
  }

  template <class Opened>
  void keep(const std::string& name, Opened opened) {
    for (const std::string& note : opened.notes) notes.push_back("camera '" + name + "': " + note);
    all.push_back(opened.camera.get());
    own.push_back(std::move(opened.camera));
  }
};

Cameras::Cameras(const CellConfig& cell, Clock& clock, sim::Cell* simulation, const CameraOptions& options)
    : impl_(std::make_unique<Impl>()) {
  if (simulation != nullptr) impl_->serve(cell, *simulation);
  for (const CameraConfig& camera : cell.cameras) {
    switch (camera.backend) {
      case CameraBackend::kSim:
        if (simulation == nullptr) refuse(camera, "the backend 'sim' needs a simulated arm.");
        impl_->all.push_back(&simulation->camera(camera.name));
        break;
      case CameraBackend::kOpenNi2: impl_->openOpenNi2(camera, clock, simulation != nullptr, options); break;
      case CameraBackend::kFreenect:
        demandRealCell(camera, "freenect", simulation);
        impl_->openFreenect(camera, clock, options);
        break;
      case CameraBackend::kV4l2:
        demandRealCell(camera, "v4l2", simulation);
        impl_->openV4l2(camera, clock, options);
        break;
    }
  }
}

Cameras::~Cameras() = default;

const std::vector<sensor::RgbdCamera*>& Cameras::all() const { return impl_->all; }
const std::vector<std::string>& Cameras::notes() const { return impl_->notes; }

}  // namespace servocal::app
