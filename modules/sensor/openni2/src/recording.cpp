// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor_openni2/recording.h"

#include <OpenNI.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <opencv2/core.hpp>
#include <string>
#include <thread>

#include "library.h"
#include "pixels.h"
#include "recorder.h"
#include "servocal/core/error.h"

namespace servocal::openni2 {
namespace {

constexpr int kPatienceMs = 3000;  ///< For one frame, of a slow disk.

struct Kind {
  Stream stream;
  openni::SensorType sensor;
};
constexpr std::array<Kind, 3> kKinds{{{Stream::kColor, openni::SENSOR_COLOR},
                                      {Stream::kInfrared, openni::SENSOR_IR},
                                      {Stream::kDepth, openni::SENSOR_DEPTH}}};

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& why) {
  throw Error(ErrorKind::kBadData, file.string() + ": " + why);
}

/// libOpenNI2 says of any other file no more than that it is no device.
void demandHeader(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::array<char, 4> head{};
  if (!in.read(head.data(), head.size())) refuse(file, "cannot be read. Check the path.");
  if (std::string(head.data(), head.size()) != "NI10") refuse(file, "is no recording of OpenNI2 (.oni).");
}

}  // namespace

struct Recording::Impl {
  std::shared_ptr<Library> library = Library::instance();
  std::filesystem::path file;
  openni::Device device;
  std::array<openni::VideoStream, kKinds.size()> players;  // In the order of `streams`.
  std::vector<RecordedStream> streams;
  std::array<int, kKinds.size()> handed_out{};

  void add(const Kind& kind, openni::PlaybackControl& control);
  bool isComplete() const;
  std::string missing() const;
  int waitForOne();
  ~Impl();
};

void Recording::Impl::add(const Kind& kind, openni::PlaybackControl& control) {
  const std::string name = toString(kind.stream);
  openni::VideoStream& player = players[streams.size()];
  if (player.create(device, kind.sensor) != openni::STATUS_OK)
    refuse(file, name + " cannot be played: " + lastError());
  const openni::VideoMode mode = player.getVideoMode();
  const auto& formats = formatsOf(kind.stream);
  if (std::find(formats.begin(), formats.end(), mode.getPixelFormat()) == formats.end())
    refuse(file, name + " is of a format that is not read here: " + nameOf(mode.getPixelFormat()) + ".");
  if (!canBePlayed(mode)) refuse(file, name + " is too big for OpenNI2's player.");
  RecordedStream stream;
  stream.stream = kind.stream;
  stream.width_px = mode.getResolutionX();
  stream.height_px = mode.getResolutionY();
  stream.rate_hz = mode.getFps();
  stream.mirrored = player.getMirroringEnabled();
  if (const int frames = control.getNumberOfFrames(player); frames >= 0) stream.frames = frames;
  streams.push_back(stream);
}

/// All that were announced have come.
bool Recording::Impl::isComplete() const {
  for (std::size_t i = 0; i < streams.size(); ++i) {
    if (!streams[i].frames || handed_out[i] < *streams[i].frames) return false;
  }
  return true;
}

std::string Recording::Impl::missing() const {
  std::string text;
  for (std::size_t i = 0; i < streams.size(); ++i) {
    const int left = streams[i].frames ? *streams[i].frames - handed_out[i] : 0;
    if (left > 0)
      text += (text.empty() ? "" : ", ") + std::to_string(left) + " of " + toString(streams[i].stream);
  }
  return text;
}

/// The place of the stream whose frame has come, or -1. Each wait lets the player go on by one frame, and by
/// another whenever it is woken for nothing, which overwrites the first. So the wake-up that an earlier frame
/// has left behind is taken away, by waiting for no stream at all.
int Recording::Impl::waitForOne() {
  std::array<openni::VideoStream*, kKinds.size()> waiting{};
  for (std::size_t i = 0; i < streams.size(); ++i) waiting[i] = &players[i];
  int ready = -1;
  (void)openni::OpenNI::waitForAnyStream(waiting.data(), 0, &ready, openni::TIMEOUT_NONE);
  const auto status =
      openni::OpenNI::waitForAnyStream(waiting.data(), static_cast<int>(streams.size()), &ready, kPatienceMs);
  return status == openni::STATUS_OK ? ready : -1;
}

Recording::Impl::~Impl() {
  for (openni::VideoStream& player : players) player.stop();
  // The player's thread walks over the streams without a lock while one of them runs; once none does, it
  // sleeps for 10 ms at a time.
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  for (openni::VideoStream& player : players) player.destroy();
  device.close();
}

Recording::Recording(const std::filesystem::path& file) : impl_(std::make_unique<Impl>()) {
  demandHeader(file);
  impl_->file = file;
  if (impl_->device.open(std::filesystem::absolute(file).c_str()) != openni::STATUS_OK) {
    refuse(file,
           "OpenNI2 does not open it: it was cut short or is damaged, or OpenNI2's player (libOniFile.so.0) "
           "is not in OpenNI2/Drivers.");
  }
  openni::PlaybackControl* const control = impl_->device.getPlaybackControl();
  if (control == nullptr) refuse(file, "is no recording of OpenNI2 (.oni).");
  // One frame whenever it is asked for: at any other speed the player overwrites what nobody has read yet.
  if (control->setSpeed(-1.0F) != openni::STATUS_OK || control->setRepeatEnabled(false) != openni::STATUS_OK)
    refuse(file, "OpenNI2 does not play it frame by frame: " + lastError());
  for (const Kind& kind : kKinds) {
    if (impl_->device.hasSensor(kind.sensor)) impl_->add(kind, *control);
  }
  if (impl_->streams.empty()) refuse(file, "holds no stream: it was ended before anything was recorded.");
  for (std::size_t i = 0; i < impl_->streams.size(); ++i) {
    if (impl_->players[i].start() != openni::STATUS_OK)
      refuse(file, std::string(toString(impl_->streams[i].stream)) + " cannot be played: " + lastError());
  }
}

Recording::~Recording() = default;

const std::vector<RecordedStream>& Recording::streams() const { return impl_->streams; }

std::optional<RecordedFrame> Recording::next() {
  if (impl_->isComplete()) return std::nullopt;
  const int ready = impl_->waitForOne();
  if (ready < 0) {
    const std::string missing = impl_->missing();
    if (missing.empty()) return std::nullopt;
    refuse(impl_->file, "ends early; frames that it announces are missing: " + missing + ".");
  }
  openni::VideoFrameRef frame;
  if (impl_->players[ready].readFrame(&frame) != openni::STATUS_OK || !frame.isValid())
    refuse(impl_->file, "a frame cannot be read: " + lastError());
  const RecordedStream& stream = impl_->streams[ready];
  RecordedFrame result;
  result.stream = stream.stream;
  result.number = ++impl_->handed_out[ready];
  if (frame.getFrameIndex() != result.number) {
    refuse(impl_->file, "frame " + std::to_string(result.number) + " of " + toString(stream.stream) +
                            " is missing or was passed over by OpenNI2's player.");
  }
  result.time_s = 1e-6 * static_cast<double>(frame.getTimestamp());
  result.image = imageOf(frame.getVideoMode().getPixelFormat(), frame.getWidth(), frame.getHeight(),
                         frame.getStrideInBytes(), frame.getData());
  if (stream.mirrored) cv::flip(result.image, result.image, 1);
  return result;
}

}  // namespace servocal::openni2
