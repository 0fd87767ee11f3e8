// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "servocal/sensor/rgbd_camera.h"

namespace servocal::openni2 {

/// One stream of a recording.
struct RecordedStream {
  Stream stream{};
  int width_px = 0;
  int height_px = 0;
  double rate_hz = 0.0;
  std::optional<int> frames;  ///< Nothing if whoever recorded it was ended before he could count.
  bool mirrored = false;      ///< As recorded; frames are turned back.
};

/// One frame of a recording.
struct RecordedFrame {
  Stream stream{};
  int number = 0;       ///< Within its stream, from 1.
  double time_s = 0.0;  ///< Since the first frame of its stream: a recording does not say when that was.
  cv::Mat image;        ///< As sensor::Frame::image, infrared as it came (CV_16UC1); never mirrored.
};

/// Reads a file that OpenNI2 recorded (.oni; `OpenOptions::record`, servocal-record, NiViewer) by OpenNI2's
/// own player, every frame once, as fast as it is asked for. For one thread.
///
/// Whether depth was registered to color when it was recorded, the file does not tell.
class Recording {
 public:
  /// @throws Error (kBadData) if `file` is no such file, holds no stream or one that cannot be read here.
  explicit Recording(const std::filesystem::path& file);
  ~Recording();
  Recording(const Recording&) = delete;
  Recording& operator=(const Recording&) = delete;

  const std::vector<RecordedStream>& streams() const;
  /// The next frame of any stream, in the order they were recorded; nothing at the end.
  /// @throws Error (kBadData) if the file ends before all frames that it announces have come.
  std::optional<RecordedFrame> next();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::openni2
