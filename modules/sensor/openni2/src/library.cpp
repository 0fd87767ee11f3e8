// SPDX-License-Identifier: GPL-3.0-or-later
#include "library.h"

#include <algorithm>

#include "servocal/core/error.h"

namespace servocal::openni2 {
namespace {

std::string serialOf(const std::string& uri) {
  openni::Device device;
  if (device.open(uri.c_str()) != openni::STATUS_OK) return {};
  char text[ONI_MAX_STR] = {};
  int size = sizeof(text) - 1;
  const auto status = device.getProperty(openni::DEVICE_PROPERTY_SERIAL_NUMBER, text, &size);
  device.close();
  return status == openni::STATUS_OK ? std::string(text) : std::string();
}

}  // namespace

std::string lastError() {
  std::string text = openni::OpenNI::getExtendedError();
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '\n' || c == '\t'; }, ' ');
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return text;
}

std::shared_ptr<Library> Library::instance() {
  static std::mutex mutex;
  static std::weak_ptr<Library> running;
  const std::lock_guard<std::mutex> lock(mutex);
  auto library = running.lock();
  if (!library) running = library = std::make_shared<Library>();
  return library;
}

Library::Library() {
  if (openni::OpenNI::initialize() != openni::STATUS_OK) {
    const std::string why = lastError();
    openni::OpenNI::shutdown();
    throw Error(
        ErrorKind::kHardwareAbsent,
        "OpenNI2 does not start: " + (why.empty() ? "it gives no reason" : why) +
            ". Its drivers belong into the folder OpenNI2/Drivers beside libOpenNI2.so.0 (docs/cameras.md).");
  }
  openni::OpenNI::addDeviceConnectedListener(this);
  openni::OpenNI::addDeviceDisconnectedListener(this);
  openni::Array<openni::DeviceInfo> list;
  openni::OpenNI::enumerateDevices(&list);
  const std::lock_guard<std::mutex> lock(mutex_);
  for (int i = 0; i < list.getSize(); ++i) plugged_.insert(list[i].getUri());
}

Library::~Library() {
  openni::OpenNI::removeDeviceConnectedListener(this);
  openni::OpenNI::removeDeviceDisconnectedListener(this);
  openni::OpenNI::shutdown();
}

bool Library::isPlugged(const std::string& uri) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return plugged_.count(uri) > 0;
}

std::vector<Device> Library::devices() const {
  openni::Array<openni::DeviceInfo> list;
  openni::OpenNI::enumerateDevices(&list);
  std::vector<Device> devices;
  for (int i = 0; i < list.getSize(); ++i) {
    const std::string uri = list[i].getUri();
    devices.push_back({uri, list[i].getVendor(), list[i].getName(), serialOf(uri)});
  }
  return devices;
}

void Library::onDeviceConnected(const openni::DeviceInfo* info) {
  const std::lock_guard<std::mutex> lock(mutex_);
  plugged_.insert(info->getUri());
}

void Library::onDeviceDisconnected(const openni::DeviceInfo* info) {
  const std::lock_guard<std::mutex> lock(mutex_);
  plugged_.erase(info->getUri());
}

std::vector<Device> devices() { return Library::instance()->devices(); }

}  // namespace servocal::openni2
