// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <OpenNI.h>

#include <filesystem>

namespace servocal::openni2 {

/// Whether OpenNI2's player takes frames of this size; of others it plays neither these nor what comes with
/// them.
bool canBePlayed(const openni::VideoMode& mode);

/// Writes every frame that the streams attached to it deliver to an .oni file, until destruction. Must go
/// before the streams do.
class Recorder {
 public:
  /// Replaces what stands at `file`. @throws Error (kBadData) if nothing can be written there.
  explicit Recorder(const std::filesystem::path& file);
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Before start(). Lossless: a compressed image has other corners.
  void attach(openni::VideoStream& stream);
  void start();

 private:
  openni::Recorder recorder_;
  std::filesystem::path file_;
};

}  // namespace servocal::openni2
