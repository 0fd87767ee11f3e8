// SPDX-License-Identifier: GPL-3.0-or-later
#include "capture_camera.h"

#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

#include "reader.h"
#include "servocal/core/error.h"
#include "servocal/sensor/stamp_clock.h"

namespace servocal::v4l2 {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPoll{1};
constexpr double kWantedHz = 30.0;
constexpr double kSlowHz = 25.0;  // Slower than this the servo has little to go by.
// V4L2's own numbers for its menu of exposure modes.
constexpr double kManualExposure = 1.0;

std::string sizeText(double width, double height) {
  return std::to_string(std::lround(width)) + " x " + std::to_string(std::lround(height));
}

class CaptureCamera final : public sensor::RgbdCamera {
 public:
  CaptureCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options, Source source)
      : config_(config), clock_(clock), options_(options), source_(std::move(source)),
        stamps_(sensor::StampClockOptions{fromSeconds(config.latency_s)}) {
    info_.name = config.name;
    info_.streams = {{Stream::kColor, config.width_px, config.height_px, kWantedHz, false}};
    open();
    if (options_.lock_exposure) lockExposure();
  }

  const sensor::CameraInfo& info() const override { return info_; }
  const std::vector<std::string>& notes() const { return notes_; }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override;

 private:
  [[noreturn]] void absent(const std::string& what) const {
    throw Error(ErrorKind::kHardwareAbsent, "Camera '" + config_.name + "' " + what);
  }
  void open();
  void demandSize(cv::VideoCapture& capture);
  void lockExposure();
  std::optional<sensor::Frame> newest();

  CameraConfig config_;
  Clock& clock_;
  OpenOptions options_;
  Source source_;
  sensor::StampClock stamps_;
  sensor::CameraInfo info_;
  std::vector<std::string> notes_;
  std::unique_ptr<Reader> reader_;
  std::optional<double> locked_exposure_, locked_white_balance_;
  std::uint64_t base_ = 0, sequence_ = 0;  ///< Numbers go on rising after the camera was plugged in again.
};

void CaptureCamera::demandSize(cv::VideoCapture& capture) {
  const auto ask = [&](int fourcc) {
    (void)capture.set(cv::CAP_PROP_FOURCC, fourcc);
    (void)capture.set(cv::CAP_PROP_FRAME_WIDTH, config_.width_px);
    (void)capture.set(cv::CAP_PROP_FRAME_HEIGHT, config_.height_px);
    (void)capture.set(cv::CAP_PROP_FPS, kWantedHz);
    return std::lround(capture.get(cv::CAP_PROP_FRAME_WIDTH)) == config_.width_px &&
           std::lround(capture.get(cv::CAP_PROP_FRAME_HEIGHT)) == config_.height_px;
  };
  const bool raw =
      ask(cv::VideoWriter::fourcc('Y', 'U', 'Y', 'V')) && !(capture.get(cv::CAP_PROP_FPS) < kSlowHz);
  if (!raw && !ask(cv::VideoWriter::fourcc('M', 'J', 'P', 'G'))) {
    absent("offers no color of " + sizeText(config_.width_px, config_.height_px) + " px, but for instance " +
           sizeText(capture.get(cv::CAP_PROP_FRAME_WIDTH), capture.get(cv::CAP_PROP_FRAME_HEIGHT)) +
           " px (width_px and height_px in the cell file; v4l2-ctl --list-formats-ext lists all).");
  }
  if (!raw) notes_.push_back("sends motion JPEG: at this size its raw images come too slowly");
  if (const double rate = capture.get(cv::CAP_PROP_FPS); rate > 0.0) info_.streams.front().rate_hz = rate;
}

void CaptureCamera::open() {
  const Node node = source_.find();
  std::unique_ptr<cv::VideoCapture> capture = source_.open(node);
  if (!capture || !capture->isOpened()) {
    absent("at " + node.path.string() + " does not open: another program may have it, or it is no camera.");
  }
  notes_.clear();
  demandSize(*capture);
  // Without autofocus there is nothing to switch off, and a refusal means nothing.
  if (!capture->set(cv::CAP_PROP_AUTOFOCUS, 0.0) && capture->get(cv::CAP_PROP_AUTOFOCUS) > 0.0) {
    notes_.push_back("autofocus cannot be switched off: whatever is calibrated holds for one focus only");
  }
  info_.model = node.name.empty() ? node.path.string() : node.name;
  info_.serial = node.name;
  if (locked_exposure_) {  // Plugged in again: as it was.
    (void)capture->set(cv::CAP_PROP_AUTO_EXPOSURE, kManualExposure);
    (void)capture->set(cv::CAP_PROP_EXPOSURE, *locked_exposure_);
  }
  if (locked_white_balance_) {
    (void)capture->set(cv::CAP_PROP_AUTO_WB, 0.0);
    (void)capture->set(cv::CAP_PROP_WB_TEMPERATURE, *locked_white_balance_);
  }
  base_ = sequence_;
  reader_ = std::make_unique<Reader>(std::move(capture), clock_);
}

void CaptureCamera::lockExposure() {
  const Instant until = clock_.now() + options_.settle;
  while (clock_.now() < until) (void)next(Stream::kColor, until);
  reader_->between([this](cv::VideoCapture& capture) {
    const double exposure = capture.get(cv::CAP_PROP_EXPOSURE);
    const double white = capture.get(cv::CAP_PROP_WB_TEMPERATURE);
    if (capture.set(cv::CAP_PROP_AUTO_EXPOSURE, kManualExposure)) {
      (void)capture.set(cv::CAP_PROP_EXPOSURE, exposure);
      locked_exposure_ = exposure;
    }
    if (capture.set(cv::CAP_PROP_AUTO_WB, 0.0)) {
      (void)capture.set(cv::CAP_PROP_WB_TEMPERATURE, white);
      locked_white_balance_ = white;
    }
  });
  if (!locked_exposure_) notes_.push_back("exposure is not locked: the camera refuses");
  if (!locked_white_balance_) notes_.push_back("white balance is not locked: the camera refuses");
}

std::optional<sensor::Frame> CaptureCamera::newest() {
  std::optional<RawFrame> raw = reader_->take();
  if (!raw) return std::nullopt;
  if (raw->image.cols != config_.width_px || raw->image.rows != config_.height_px ||
      raw->image.type() != CV_8UC3) {
    absent("sent an image of " + sizeText(raw->image.cols, raw->image.rows) + " px instead of " +
           sizeText(config_.width_px, config_.height_px) + " px in color.");
  }
  sensor::Frame frame;
  frame.stream = Stream::kColor;
  frame.received = raw->received;
  frame.device_stamp_s = raw->driver_stamp_s > 0.0 ? raw->driver_stamp_s : toSeconds(raw->received);
  frame.stamp = stamps_.read(frame.device_stamp_s, frame.received).stamp;
  frame.sequence = sequence_ = base_ + raw->number + 1;
  frame.image = std::move(raw->image);
  return frame;
}

std::optional<sensor::Frame> CaptureCamera::next(Stream stream, Instant deadline) {
  if (stream != Stream::kColor)
    throw std::invalid_argument("camera '" + info_.name + "' has no " + toString(stream) + " stream");
  for (;;) {
    if (!reader_ || !reader_->alive()) {
      reader_.reset();
      open();  // Throws as long as it is away.
    }
    if (auto frame = newest()) return frame;
    if (clock_.now() >= deadline) return std::nullopt;
    clock_.sleepUntil(std::min(deadline, clock_.now() + kPoll));
  }
}

}  // namespace

OpenedCamera openFrom(const CameraConfig& config, Clock& clock, const OpenOptions& options, Source source) {
  if (config.infrared) {
    throw Error(ErrorKind::kInvalidConfig, "Camera '" + config.name +
                                               "': the backend 'v4l2' has color only; leave out its "
                                               "'infrared' section.");
  }
  auto camera = std::make_unique<CaptureCamera>(config, clock, options, std::move(source));
  OpenedCamera opened;
  opened.notes = camera->notes();
  opened.notes.push_back("not run on a real UVC camera: tested with made-up captures only (docs/limits.md)");
  opened.camera = std::move(camera);
  return opened;
}

}  // namespace servocal::v4l2
