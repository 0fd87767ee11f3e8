// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

namespace servocal::session {

struct ImageSize {
  int width_px = 0;
  int height_px = 0;
  bool operator==(const ImageSize& other) const {
    return width_px == other.width_px && height_px == other.height_px;
  }
};

/// Size of an image, and proof that its file is whole: image libraries fill the rest of a truncated
/// JPEG with gray and say nothing. JPEG and PNG are walked without decoding, others are decoded.
/// @throws Error (kBadData) naming the file and what is wrong with it.
ImageSize checkImage(const std::filesystem::path& file);

}  // namespace servocal::session
