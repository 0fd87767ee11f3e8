// SPDX-License-Identifier: GPL-3.0-or-later
#include "device.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <exception>
#include <optional>

namespace servocal::sim_openni2_driver {
namespace {

OniSensorType sensorTypeOf(Stream stream) {
  switch (stream) {
    case Stream::kColor: return ONI_SENSOR_COLOR;
    case Stream::kInfrared: return ONI_SENSOR_IR;
    case Stream::kDepth: return ONI_SENSOR_DEPTH;
  }
  return ONI_SENSOR_COLOR;
}

OniPixelFormat formatOf(Stream stream, bool tenth_millimetres) {
  switch (stream) {
    case Stream::kColor: return ONI_PIXEL_FORMAT_RGB888;
    case Stream::kInfrared: return ONI_PIXEL_FORMAT_GRAY16;
    case Stream::kDepth:
      return tenth_millimetres ? ONI_PIXEL_FORMAT_DEPTH_100_UM : ONI_PIXEL_FORMAT_DEPTH_1_MM;
  }
  return ONI_PIXEL_FORMAT_RGB888;
}

/// The camera's side of which only one runs, if they exclude each other.
bool isColorSide(Stream stream) { return stream == Stream::kColor; }

}  // namespace

ServedDevice::ServedDevice(const Served& served, const Clock& clock) : served_(served), clock_(clock) {
  setPropertyChangedCallback([](void*, int, const void*, int, void*) {},
                             nullptr);  // The base leaves it wild.
  for (const sensor::StreamMode& mode : served.camera->info().streams) {
    Sensor sensor;
    sensor.mode = mode;
    const OniPixelFormat format = formatOf(mode.stream, served.tenth_millimetres);
    // As devices do, a smaller mode first: who does not ask for a mode gets that.
    const int fps = static_cast<int>(std::lround(mode.rate_hz));
    sensor.modes = {{format, mode.width_px / 2, mode.height_px / 2, fps},
                    {format, mode.width_px, mode.height_px, fps}};
    sensors_.push_back(sensor);
  }
  for (Sensor& sensor : sensors_) {
    infos_.push_back(
        {sensorTypeOf(sensor.mode.stream), static_cast<int>(sensor.modes.size()), sensor.modes.data()});
  }
}

OniStatus ServedDevice::getSensorInfoList(OniSensorInfo** infos, int* count) {
  *infos = infos_.data();
  *count = static_cast<int>(infos_.size());
  return ONI_STATUS_OK;
}

const ServedDevice::Sensor* ServedDevice::find(OniSensorType type) const {
  const auto found = std::find_if(sensors_.begin(), sensors_.end(), [&](const Sensor& sensor) {
    return sensorTypeOf(sensor.mode.stream) == type;
  });
  return found == sensors_.end() ? nullptr : &*found;
}

oni::driver::StreamBase* ServedDevice::createStream(OniSensorType type) {
  const Sensor* const sensor = find(type);
  if (sensor == nullptr) return nullptr;
  streams_.push_back(std::make_unique<ServedStream>(sensor->mode.stream, sensor->modes));
  oni::driver::StreamBase* const stream = streams_.back().get();
  tellRivals();
  return stream;
}

void ServedDevice::destroyStream(oni::driver::StreamBase* stream) {
  streams_.erase(
      std::remove_if(streams_.begin(), streams_.end(),
                     [&](const std::unique_ptr<ServedStream>& own) { return own.get() == stream; }),
      streams_.end());
  tellRivals();
}

void ServedDevice::tellRivals() {
  const bool exclusive = std::any_of(sensors_.begin(), sensors_.end(),
                                     [](const Sensor& sensor) { return sensor.mode.exclusive; });
  if (!exclusive) return;
  for (const auto& stream : streams_) {
    std::vector<const ServedStream*> rivals;
    for (const auto& other : streams_) {
      if (isColorSide(other->stream()) != isColorSide(stream->stream())) rivals.push_back(other.get());
    }
    stream->setRivals(rivals);
  }
}

OniStatus ServedDevice::setProperty(int id, const void* data, int size) {
  if (id != ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION || size != sizeof(registration_))
    return ONI_STATUS_NOT_SUPPORTED;
  std::memcpy(&registration_, data, sizeof(registration_));
  return ONI_STATUS_OK;
}

OniStatus ServedDevice::getProperty(int id, void* data, int* size) {
  if (id == ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION && *size == sizeof(registration_)) {
    std::memcpy(data, &registration_, sizeof(registration_));
    return ONI_STATUS_OK;
  }
  if (id == ONI_DEVICE_PROPERTY_SERIAL_NUMBER && served_.has_serial) {
    const std::string& serial = served_.camera->info().serial;
    if (*size <= static_cast<int>(serial.size())) return ONI_STATUS_BAD_PARAMETER;
    std::memcpy(data, serial.c_str(), serial.size() + 1);
    *size = static_cast<int>(serial.size() + 1);
    return ONI_STATUS_OK;
  }
  return ONI_STATUS_NOT_SUPPORTED;
}

OniBool ServedDevice::isPropertySupported(int id) {
  return id == ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION ||
         (id == ONI_DEVICE_PROPERTY_SERIAL_NUMBER && served_.has_serial);
}

OniStatus ServedDevice::tryManualTrigger() {
  if (!plugged_) return ONI_STATUS_NO_DEVICE;
  for (const auto& stream : streams_) {
    if (!stream->isRunning()) continue;
    std::optional<sensor::Frame> frame;
    try {
      // What has been delivered by now; the camera does not let time pass for a deadline that is now.
      frame = served_.camera->next(stream->stream(), clock_.now());
    } catch (const std::exception&) {
      return ONI_STATUS_ERROR;  // Nothing may be thrown through libOpenNI2.
    }
    if (!frame) continue;
    // A wrong depth would not show: registered depth is blank, so that whoever forgets to switch it off sees
    // none.
    if (stream->stream() == Stream::kDepth && registration_ != ONI_IMAGE_REGISTRATION_OFF)
      frame->image.setTo(0);
    stream->push(*frame);
  }
  return ONI_STATUS_OK;
}

}  // namespace servocal::sim_openni2_driver
