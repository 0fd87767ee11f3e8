// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <libfreenect.h>

#include <atomic>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/sensor/device_streams.h"

namespace servocal::freenect {

/// libfreenect, started.
class Context {
 public:
  /// @throws Error (kHardwareAbsent) if libfreenect does not start.
  Context();
  ~Context();
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  freenect_context* get() const { return context_; }
  /// Of the Kinects that can be opened.
  std::vector<std::string> serials() const;

 private:
  freenect_context* context_ = nullptr;
};

/// What libfreenect says of its last failure in this process, as " (...)"; empty if nothing.
std::string lastError();

/// An open Kinect v1. libfreenect is called by one thread alone, which also carries its frames.
class Kinect {
 public:
  using Image = sensor::DeviceStream::Image;

  /// @throws Error (kHardwareAbsent) if it does not open; `camera` names it.
  Kinect(const std::string& serial, const std::string& camera, const Clock& clock);
  ~Kinect();
  Kinect(const Kinect&) = delete;
  Kinect& operator=(const Kinect&) = delete;

  /// False once it is gone.
  bool alive() const { return alive_; }
  /// False if the device refuses. `wide`: color of 1280 x 1024.
  bool start(Stream stream, bool wide);
  void stop(Stream stream);
  /// Exposure and white balance stay as they are; false if the device refuses.
  bool lockExposure();
  /// The newest image that was not taken yet.
  std::optional<Image> take(Stream stream);

 private:
  static void onVideo(freenect_device* device, void* pixels, std::uint32_t stamp);
  static void onDepth(freenect_device* device, void* pixels, std::uint32_t stamp);
  void keep(Stream stream, cv::Mat pixels, std::uint32_t stamp);
  double unwrapped(std::uint32_t stamp, Instant received);
  /// Does something with the device between two of its frames, on its thread; false if it is gone.
  bool between(std::function<bool(freenect_device*)> action);
  void run();

  const Clock& clock_;
  Context context_;
  freenect_device* device_ = nullptr;  ///< The thread's own once it runs.
  Stream video_ = Stream::kColor;      ///< Of the thread: what the video stream is now.
  std::optional<double> zero_s_;       ///< Of the thread: the run's time at stamp 0 of the device.
  std::mutex mutex_;                   ///< Guards the three below.
  std::map<Stream, Image> newest_;
  std::map<Stream, std::uint64_t> came_;  ///< Images since the device was opened.
  std::optional<std::packaged_task<bool(freenect_device*)>> action_;
  std::atomic<bool> alive_{true};
  std::atomic<bool> quit_{false};
  std::thread thread_;
};

}  // namespace servocal::freenect
