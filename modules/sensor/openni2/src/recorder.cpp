// SPDX-License-Identifier: GPL-3.0-or-later
#include "recorder.h"

#include <fstream>

#include "library.h"
#include "servocal/core/error.h"

namespace servocal::openni2 {
namespace {

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& why) {
  throw Error(ErrorKind::kBadData,
              file.string() + ": cannot be recorded to" + (why.empty() ? "" : ": " + why) + ".");
}

}  // namespace

bool canBePlayed(const openni::VideoMode& mode) {
  constexpr int kMostBytes = 1600 * 1200 * 3;  // Of libOniFile 2.2, for the decoded frame.
  const int bytes = mode.getPixelFormat() == openni::PIXEL_FORMAT_RGB888 ? 3 : 2;
  return mode.getResolutionX() * mode.getResolutionY() * bytes <= kMostBytes;
}

Recorder::Recorder(const std::filesystem::path& file) : file_(file) {
  // libOpenNI2 2.2 crashes where it cannot write.
  if (!std::ofstream(file, std::ios::binary)) refuse(file, "no file can be written there");
  if (recorder_.create(file.c_str()) != openni::STATUS_OK) refuse(file, lastError());
}

Recorder::~Recorder() { recorder_.destroy(); }

void Recorder::attach(openni::VideoStream& stream) {
  if (recorder_.attach(stream, /*allowLossyCompression=*/FALSE) != openni::STATUS_OK)
    refuse(file_, lastError());
}

void Recorder::start() {
  if (recorder_.start() != openni::STATUS_OK) refuse(file_, lastError());
}

}  // namespace servocal::openni2
