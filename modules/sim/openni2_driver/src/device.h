// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <deque>
#include <memory>
#include <vector>

#include "driver_api.h"
#include "servocal/sim_openni2_driver/served_cameras.h"
#include "stream.h"

namespace servocal::sim_openni2_driver {

/// A served camera that somebody has opened.
class ServedDevice final : public oni::driver::DeviceBase {
 public:
  ServedDevice(const Served& served, const Clock& clock);

  OniStatus getSensorInfoList(OniSensorInfo** infos, int* count) override;
  oni::driver::StreamBase* createStream(OniSensorType type) override;
  void destroyStream(oni::driver::StreamBase* stream) override;
  OniStatus setProperty(int id, const void* data, int size) override;
  OniStatus getProperty(int id, void* data, int* size) override;
  OniBool isPropertySupported(int id) override;
  OniStatus tryManualTrigger() override;
  OniBool isImageRegistrationModeSupported(OniImageRegistrationMode) override { return TRUE; }

  bool hasFrameSync() const { return served_.frame_sync; }
  void pullOut() { plugged_ = false; }

 private:
  struct Sensor {
    sensor::StreamMode mode;
    std::vector<OniVideoMode> modes;
  };
  const Sensor* find(OniSensorType type) const;
  void tellRivals();

  Served served_;
  const Clock& clock_;
  std::vector<Sensor> sensors_;
  std::vector<OniSensorInfo> infos_;
  std::vector<std::unique_ptr<ServedStream>> streams_;
  OniImageRegistrationMode registration_ = ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR;  // As some devices come up.
  bool plugged_ = true;
};

}  // namespace servocal::sim_openni2_driver
