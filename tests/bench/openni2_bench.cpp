// SPDX-License-Identifier: GPL-3.0-or-later
// What the OpenNI2 backend costs beyond libOpenNI2 itself: 1080p color and depth, read barely and through our
// backend.
#include <OpenNI.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

#include "servocal/sensor_openni2/camera.h"
#include "servocal/sim_openni2_driver/served_cameras.h"

namespace {

using namespace servocal;

/// Two images of noise, shown in turn 30 times a second: a device that costs nothing.
class NoiseCamera final : public sensor::RgbdCamera {
 public:
  explicit NoiseCamera(const Clock& clock) : clock_(clock) {
    info_.name = "noise";
    info_.model = "noise";
    info_.serial = "noise-1";
    info_.streams = {{Stream::kColor, 1920, 1080, kRateHz, false},
                     {Stream::kInfrared, 512, 424, kRateHz, false},
                     {Stream::kDepth, 512, 424, kRateHz, false}};
    for (int i = 0; i < 2; ++i) {
      color_[i].create(1080, 1920, CV_8UC3);
      depth_[i].create(424, 512, CV_16UC1);
      cv::randu(color_[i], 0, 256);
      cv::randu(depth_[i], 500, 4500);
    }
  }
  const sensor::CameraInfo& info() const override { return info_; }
  std::optional<sensor::Frame> next(Stream stream, Instant) override {
    const auto number = static_cast<std::uint64_t>(kRateHz * toSeconds(clock_.now()));
    if (number <= last_[stream]) return std::nullopt;
    sensor::Frame frame;
    frame.stream = stream;
    // In order: what was not fetched in time is what the backend is to blame for.
    frame.sequence = last_[stream] = number;
    frame.device_stamp_s = static_cast<double>(number) / kRateHz;
    frame.image = (stream == Stream::kColor ? color_ : depth_)[number % 2];
    return frame;
  }

 private:
  static constexpr double kRateHz = 30.0;
  const Clock& clock_;
  sensor::CameraInfo info_;
  cv::Mat color_[2], depth_[2];
  std::map<Stream, std::uint64_t> last_;
};

struct Row {
  int color = 0, depth = 0, dropped = 0;
  double rate_hz = 0.0, cpu_share = 0.0;
};

double cpuS() {
  timespec now{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Counts frames and the numbers that are missing between them.
class Counter {
 public:
  void see(std::uint64_t number) {
    if (frames_ > 0 && number > last_) dropped_ += static_cast<int>(number - last_ - 1);
    last_ = number;
    ++frames_;
  }
  int frames() const { return frames_; }
  int dropped() const { return dropped_; }

 private:
  std::uint64_t last_ = 0;
  int frames_ = 0, dropped_ = 0;
};

/// `fetch` reads what is there and says so to the counters; called once in a millisecond.
Row measure(Clock& clock, double seconds, const std::function<void(Counter& color, Counter& depth)>& fetch) {
  Counter color, depth;
  const Instant start = clock.now(), until = start + fromSeconds(seconds);
  const double cpu_before_s = cpuS();
  while (clock.now() < until) fetch(color, depth);
  const double passed_s = toSeconds(clock.now() - start);
  return {color.frames(), depth.frames(), color.dropped() + depth.dropped(), color.frames() / passed_s,
          (cpuS() - cpu_before_s) / passed_s};
}

Row bare(WallClock& clock, double seconds) {
  openni::OpenNI::initialize();
  openni::Device device;
  if (device.open(sim_openni2_driver::uriOf("noise").c_str()) != openni::STATUS_OK)
    throw std::runtime_error("the device does not open");
  device.setImageRegistrationMode(openni::IMAGE_REGISTRATION_OFF);
  openni::VideoStream color, depth;
  color.create(device, openni::SENSOR_COLOR);
  depth.create(device, openni::SENSOR_DEPTH);
  for (openni::VideoStream* const stream : {&color, &depth}) {
    const auto& modes = stream->getSensorInfo().getSupportedVideoModes();
    stream->setVideoMode(modes[modes.getSize() - 1]);
    stream->setMirroringEnabled(false);
    stream->start();
  }
  const Row row = measure(clock, seconds, [&](Counter& colors, Counter& depths) {
    openni::VideoStream* streams[] = {&color, &depth};
    int ready = -1;
    openni::VideoFrameRef frame;
    while (openni::OpenNI::waitForAnyStream(streams, 2, &ready, openni::TIMEOUT_NONE) == openni::STATUS_OK &&
           streams[ready]->readFrame(&frame) == openni::STATUS_OK)
      (ready == 0 ? colors : depths).see(static_cast<std::uint64_t>(frame.getFrameIndex()));
    clock.sleepFor(std::chrono::milliseconds(1));
  });
  color.destroy();
  depth.destroy();
  device.close();
  openni::OpenNI::shutdown();
  return row;
}

Row backend(WallClock& clock, double seconds) {
  CameraConfig config;
  config.name = "noise";
  config.backend = CameraBackend::kOpenNi2;
  config.width_px = 1920;
  config.height_px = 1080;
  config.infrared = InfraredConfig{};
  config.infrared->width_px = 512;
  config.infrared->height_px = 424;
  config.infrared->depth = DepthSensor::kTimeOfFlight;
  const auto opened = openni2::openCamera(config, clock);
  return measure(clock, seconds, [&](Counter& colors, Counter& depths) {
    const Instant deadline = clock.now() + std::chrono::milliseconds(100);
    if (const auto frame = opened.camera->next(Stream::kColor, deadline)) colors.see(frame->sequence);
    if (const auto frame = opened.camera->next(Stream::kDepth, deadline)) depths.see(frame->sequence);
  });
}

void print(const char* name, const Row& row) {
  std::printf("%-14s %6d %6d %8d %8.2f %10.1f\n", name, row.color, row.depth, row.dropped, row.rate_hz,
              100.0 * row.cpu_share);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("CPU and lost frames of the OpenNI2 backend at 1080p color and depth, beside a bare reader.",
               "openni2_bench");
  double seconds = 60.0;
  cli.add_option("--seconds", seconds, "For each reader")->capture_default_str();
  CLI11_PARSE(cli, argc, argv);
  WallClock clock;
  NoiseCamera camera(clock);
  const sim_openni2_driver::ServedCameras served(clock, {{&camera}});
  std::printf("reader          color  depth  dropped       Hz  %% of a core\n");
  const Row without = bare(clock, seconds);
  print("libOpenNI2", without);
  const Row with = backend(clock, seconds);
  print("our backend", with);
  double load[1] = {0.0};
  ::getloadavg(load, 1);
  std::printf("beyond the library's own work: %.1f %% of a core; load of the computer %.1f\n",
              100.0 * (with.cpu_share - without.cpu_share), load[0]);
}
