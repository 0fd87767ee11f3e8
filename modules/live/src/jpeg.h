// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>

namespace servocal::live {

/// A frame (8 or 16 bit gray, or BGR) as a JPEG in a data URL, at most 960 px wide; 16 bit are stretched to
/// what occurs.
std::string jpegDataUrl(const cv::Mat& image);

}  // namespace servocal::live
