// SPDX-License-Identifier: GPL-3.0-or-later
// The OpenNI2 driver that libOpenNI2 loads: devices come and go as the program says through the bus.
#include <cstdio>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "bus.h"
#include "device.h"

namespace servocal::sim_openni2_driver {
namespace {

OniDeviceInfo describe(const std::string& uri, const Served& served) {
  OniDeviceInfo info{};
  std::snprintf(info.uri, sizeof(info.uri), "%s", uri.c_str());
  std::snprintf(info.vendor, sizeof(info.vendor), "servocal");
  std::snprintf(info.name, sizeof(info.name), "%s", served.camera->info().model.c_str());
  return info;
}

class ServedDriver;

class PluginBus final : public Bus {
 public:
  void plug(const std::string& uri, const Served& served, const Clock& clock) override;
  void unplug(const std::string& uri) override;

  struct Entry {
    Served served;
    const Clock* clock;
  };
  const std::map<std::string, Entry>& entries() const { return entries_; }
  void setDriver(ServedDriver* driver) { driver_ = driver; }

 private:
  std::map<std::string, Entry> entries_;
  ServedDriver* driver_ = nullptr;
};

PluginBus& bus() {
  static PluginBus instance;
  return instance;
}

class ServedDriver final : public oni::driver::DriverBase {
 public:
  explicit ServedDriver(OniDriverServices* services) : DriverBase(services) {}

  OniStatus initialize(oni::driver::DeviceConnectedCallback connected,
                       oni::driver::DeviceDisconnectedCallback disconnected,
                       oni::driver::DeviceStateChangedCallback changed, void* cookie) override {
    DriverBase::initialize(connected, disconnected, changed, cookie);
    bus().setDriver(this);
    for (const auto& [uri, entry] : bus().entries()) arrive(uri, entry);
    return ONI_STATUS_OK;
  }
  void shutdown() override { bus().setDriver(nullptr); }

  OniStatus tryDevice(const char* uri) override {
    return bus().entries().count(uri) > 0 ? ONI_STATUS_OK : ONI_STATUS_NO_DEVICE;
  }
  oni::driver::DeviceBase* deviceOpen(const char* uri, const char*) override {
    const auto found = bus().entries().find(uri);
    if (found == bus().entries().end()) return nullptr;
    auto device = std::make_unique<ServedDevice>(found->second.served, *found->second.clock);
    return (devices_[uri] = std::move(device)).get();
  }
  void deviceClose(oni::driver::DeviceBase* device) override {
    for (auto entry = devices_.begin(); entry != devices_.end(); ++entry) {
      if (entry->second.get() != device) continue;
      devices_.erase(entry);
      return;
    }
    pulled_out_.erase(device);
  }

  void* enableFrameSync(oni::driver::StreamBase**, int) override {
    for (const auto& [uri, device] : devices_) {
      if (device->hasFrameSync()) return device.get();
    }
    return nullptr;
  }

  void arrive(const std::string& uri, const PluginBus::Entry& entry) {
    const OniDeviceInfo info = describe(uri, entry.served);
    deviceConnected(&info);
  }
  void leave(const std::string& uri, const PluginBus::Entry& entry) {
    if (const auto open = devices_.find(uri); open != devices_.end()) {
      open->second->pullOut();
      // Whoever has it open closes it later.
      pulled_out_[open->second.get()] = std::move(open->second);
      devices_.erase(open);
    }
    const OniDeviceInfo info = describe(uri, entry.served);
    deviceDisconnected(&info);
  }

 private:
  std::map<std::string, std::unique_ptr<ServedDevice>> devices_;
  std::map<oni::driver::DeviceBase*, std::unique_ptr<ServedDevice>> pulled_out_;
};

void PluginBus::plug(const std::string& uri, const Served& served, const Clock& clock) {
  const auto [entry, is_new] = entries_.insert({uri, {served, &clock}});
  if (is_new && driver_ != nullptr) driver_->arrive(uri, entry->second);
}

void PluginBus::unplug(const std::string& uri) {
  const auto found = entries_.find(uri);
  if (found == entries_.end()) return;
  const Entry entry = found->second;
  entries_.erase(found);
  if (driver_ != nullptr) driver_->leave(uri, entry);
}

}  // namespace
}  // namespace servocal::sim_openni2_driver

extern "C" __attribute__((visibility("default"))) servocal::sim_openni2_driver::Bus* servocalOpenNi2Bus() {
  return &servocal::sim_openni2_driver::bus();
}

ONI_EXPORT_DRIVER(servocal::sim_openni2_driver::ServedDriver)
