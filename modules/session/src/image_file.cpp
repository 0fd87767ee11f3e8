// SPDX-License-Identifier: GPL-3.0-or-later
#include "image_file.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <iterator>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <vector>

#include "servocal/core/error.h"
#include "servocal/session/image_set.h"

namespace servocal::session {
namespace {

using Bytes = std::vector<unsigned char>;

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& cause) {
  throw Error(ErrorKind::kBadData, "image '" + file.string() + "' " + cause);
}

Bytes readBytes(const std::filesystem::path& file) {
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) refuse(file, "is not there");
  std::ifstream in(file, std::ios::binary);
  if (!in || std::filesystem::is_directory(file, ignored)) refuse(file, "cannot be read");
  Bytes bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  if (bytes.empty()) refuse(file, "is empty");
  return bytes;
}

bool startsWith(const Bytes& bytes, std::initializer_list<unsigned char> signature) {
  return bytes.size() >= signature.size() && std::equal(signature.begin(), signature.end(), bytes.begin());
}

int bigEndian(const Bytes& bytes, std::size_t at, int count) {
  int value = 0;
  for (int i = 0; i < count; ++i) value = value * 256 + bytes[at + i];
  return value;
}

/// Walks the markers from the start to the end-of-image marker (ITU T.81, B.1); nothing if the file ends
/// before it.
std::optional<ImageSize> walkJpeg(const Bytes& bytes) {
  ImageSize size;
  std::size_t at = 2;
  while (at + 1 < bytes.size()) {
    if (bytes[at] != 0xFF) {  // Inside the coded data of a scan.
      ++at;
      continue;
    }
    const int marker = bytes[at + 1];
    const bool stuffed = marker == 0x00 || marker == 0xFF || (marker >= 0xD0 && marker <= 0xD7);
    if (marker == 0xD9) return size;
    if (stuffed) {
      at += marker == 0xFF ? 1 : 2;
      continue;
    }
    if (at + 9 > bytes.size()) return std::nullopt;
    const bool frame_header =
        marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (frame_header) size = {bigEndian(bytes, at + 7, 2), bigEndian(bytes, at + 5, 2)};
    at += 2 + static_cast<std::size_t>(bigEndian(bytes, at + 2, 2));
  }
  return std::nullopt;
}

/// Walks the chunks to IEND (PNG specification, 5.3); nothing if the file ends before it.
std::optional<ImageSize> walkPng(const Bytes& bytes) {
  if (bytes.size() < 33) return std::nullopt;
  const ImageSize size{bigEndian(bytes, 16, 4), bigEndian(bytes, 20, 4)};
  std::size_t at = 8;
  while (at + 12 <= bytes.size()) {
    if (std::memcmp(&bytes[at + 4], "IEND", 4) == 0) return size;
    at += 12 + static_cast<std::size_t>(static_cast<unsigned>(bigEndian(bytes, at, 4)));
  }
  return std::nullopt;
}

cv::Mat decode(const Bytes& bytes, const std::filesystem::path& file) {
  cv::Mat image;
  try {
    image = cv::imdecode(bytes, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    // An empty image says the same.
  }
  if (image.empty()) refuse(file, "is not an image that can be decoded");
  return image;
}

ImageSize check(const Bytes& bytes, const std::filesystem::path& file) {
  const bool jpeg = startsWith(bytes, {0xFF, 0xD8, 0xFF});
  const bool png = startsWith(bytes, {0x89, 'P', 'N', 'G'});
  if (!jpeg && !png) {
    const cv::Mat image = decode(bytes, file);
    return {image.cols, image.rows};
  }
  const std::optional<ImageSize> size = jpeg ? walkJpeg(bytes) : walkPng(bytes);
  if (!size) {
    refuse(file, "is truncated: the file ends after " + std::to_string(bytes.size()) +
                     " bytes, before the end of the picture; copy it again or take it out of the set");
  }
  if (size->width_px <= 0 || size->height_px <= 0) refuse(file, "is damaged: it has no size");
  return *size;
}

}  // namespace

ImageSize checkImage(const std::filesystem::path& file) { return check(readBytes(file), file); }

cv::Mat readImage(const std::filesystem::path& file) {
  const Bytes bytes = readBytes(file);
  check(bytes, file);
  return decode(bytes, file);
}

}  // namespace servocal::session
