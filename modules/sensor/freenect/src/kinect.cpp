// SPDX-License-Identifier: GPL-3.0-or-later
#include "kinect.h"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "servocal/core/error.h"

namespace servocal::freenect {
namespace {

constexpr double kStampHz = 60e6;
constexpr double kWrapS = 4294967296.0 / kStampHz;
constexpr int kRows = 480;
constexpr timeval kWait{0, 10000};  // How long an action may have to wait for its turn, about.

std::mutex last_error_mutex;
std::string last_error;

void keepError(freenect_context*, freenect_loglevel level, const char* message) {
  if (level > FREENECT_LOG_ERROR) return;
  const std::lock_guard<std::mutex> lock(last_error_mutex);
  last_error = message;
  while (!last_error.empty() && (last_error.back() == '\n' || last_error.back() == '.'))
    last_error.pop_back();
}

/// Changes nothing if the library does not know the mode.
bool setVideoMode(freenect_device* device, freenect_resolution resolution, freenect_video_format format) {
  const freenect_frame_mode mode = freenect_find_video_mode(resolution, format);
  return mode.is_valid != 0 && freenect_set_video_mode(device, mode) == 0;
}

bool setDepthMode(freenect_device* device) {
  const freenect_frame_mode mode = freenect_find_depth_mode(FREENECT_RESOLUTION_MEDIUM, FREENECT_DEPTH_MM);
  return mode.is_valid != 0 && freenect_set_depth_mode(device, mode) == 0;
}

}  // namespace

std::string lastError() {
  const std::lock_guard<std::mutex> lock(last_error_mutex);
  return last_error.empty() ? "" : " (" + last_error + ")";
}

Context::Context() {
  if (freenect_init(&context_, nullptr) < 0)
    throw Error(ErrorKind::kHardwareAbsent, "libfreenect does not start: it cannot reach the USB.");
  freenect_set_log_level(context_, FREENECT_LOG_ERROR);
  freenect_set_log_callback(context_, keepError);
  // The motor is another USB device, which we neither need nor may be allowed to open.
  freenect_select_subdevices(context_, FREENECT_DEVICE_CAMERA);
}

Context::~Context() { freenect_shutdown(context_); }

std::vector<std::string> Context::serials() const {
  freenect_device_attributes* list = nullptr;
  std::vector<std::string> all;
  if (freenect_list_device_attributes(context_, &list) < 0) return all;
  for (const freenect_device_attributes* one = list; one != nullptr; one = one->next)
    all.emplace_back(one->camera_serial);
  freenect_free_device_attributes(list);
  return all;
}

Kinect::Kinect(const std::string& serial, const std::string& camera, const Clock& clock) : clock_(clock) {
  if (freenect_open_device_by_camera_serial(context_.get(), &device_, serial.c_str()) < 0) {
    throw Error(ErrorKind::kHardwareAbsent,
                "Camera '" + camera + "' (Kinect v1 " + serial + ") does not open" + lastError() +
                    ". Another program may have it, or this user may not (servocal-devices tells).");
  }
  freenect_set_user(device_, this);
  freenect_set_video_callback(device_, onVideo);
  freenect_set_depth_callback(device_, onDepth);
  thread_ = std::thread([this] { run(); });
}

Kinect::~Kinect() {
  quit_ = true;
  thread_.join();
}

void Kinect::run() {
  timeval wait = kWait;
  while (!quit_ && freenect_process_events_timeout(context_.get(), &wait) >= 0) {
    std::optional<std::packaged_task<bool(freenect_device*)>> action;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      action = std::exchange(action_, std::nullopt);
    }
    if (action) (*action)(device_);
    wait = kWait;
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    alive_ = false;
    action_.reset();  // Whoever waits for it goes on.
  }
  freenect_stop_video(device_);
  freenect_stop_depth(device_);
  freenect_close_device(device_);
}

bool Kinect::between(std::function<bool(freenect_device*)> action) {
  std::future<bool> done;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!alive_) return false;
    done = action_.emplace(std::move(action)).get_future();
  }
  try {
    return done.get();
  } catch (const std::future_error&) {
    return false;  // It went away before its turn came.
  }
}

bool Kinect::start(Stream stream, bool wide) {
  return between([this, stream, wide](freenect_device* device) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      newest_.erase(stream);
    }
    if (stream == Stream::kDepth) return setDepthMode(device) && freenect_start_depth(device) == 0;
    video_ = stream;
    const bool set = stream == Stream::kInfrared
                         ? setVideoMode(device, FREENECT_RESOLUTION_MEDIUM, FREENECT_VIDEO_IR_10BIT)
                         : setVideoMode(device, wide ? FREENECT_RESOLUTION_HIGH : FREENECT_RESOLUTION_MEDIUM,
                                        FREENECT_VIDEO_RGB);
    return set && freenect_start_video(device) == 0;
  });
}

void Kinect::stop(Stream stream) {
  (void)between([stream](freenect_device* device) {
    return (stream == Stream::kDepth ? freenect_stop_depth(device) : freenect_stop_video(device)) == 0;
  });
}

bool Kinect::lockExposure() {
  return between([](freenect_device* device) {
    const bool exposure = freenect_set_flag(device, FREENECT_AUTO_EXPOSURE, FREENECT_OFF) == 0;
    const bool white = freenect_set_flag(device, FREENECT_AUTO_WHITE_BALANCE, FREENECT_OFF) == 0;
    return exposure && white;
  });
}

void Kinect::onVideo(freenect_device* device, void* pixels, std::uint32_t stamp) {
  Kinect& self = *static_cast<Kinect*>(freenect_get_user(device));
  const freenect_frame_mode mode = freenect_get_current_video_mode(device);
  if (self.video_ == Stream::kInfrared) {
    const cv::Mat all(mode.height, mode.width, CV_16UC1, pixels);
    const int above = (mode.height - kRows) / 2;
    self.keep(Stream::kInfrared, all.rowRange(above, above + kRows).clone(), stamp);
  } else {
    cv::Mat image;
    cv::cvtColor(cv::Mat(mode.height, mode.width, CV_8UC3, pixels), image, cv::COLOR_RGB2BGR);
    self.keep(Stream::kColor, std::move(image), stamp);
  }
}

void Kinect::onDepth(freenect_device* device, void* pixels, std::uint32_t stamp) {
  const freenect_frame_mode mode = freenect_get_current_depth_mode(device);
  static_cast<Kinect*>(freenect_get_user(device))
      ->keep(Stream::kDepth, cv::Mat(mode.height, mode.width, CV_16UC1, pixels).clone(), stamp);
}

/// The counter has 32 bits, and nobody may look for longer than it takes to turn: the host's clock says how
/// often it has.
double Kinect::unwrapped(std::uint32_t stamp, Instant received) {
  const double device_s = stamp / kStampHz;
  if (!zero_s_) zero_s_ = toSeconds(received) - device_s;
  return device_s + kWrapS * std::round((toSeconds(received) - *zero_s_ - device_s) / kWrapS);
}

void Kinect::keep(Stream stream, cv::Mat pixels, std::uint32_t stamp) {
  Image image;
  image.received = clock_.now();
  image.device_stamp_s = unwrapped(stamp, *image.received);
  image.pixels = std::move(pixels);
  const std::lock_guard<std::mutex> lock(mutex_);
  image.number = ++came_[stream];
  newest_[stream] = std::move(image);
}

std::optional<Kinect::Image> Kinect::take(Stream stream) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = newest_.find(stream);
  if (found == newest_.end()) return std::nullopt;
  Image image = std::move(found->second);
  newest_.erase(found);
  return image;
}

}  // namespace servocal::freenect
