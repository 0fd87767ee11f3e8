// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <OpenNI.h>

#include <opencv2/core/mat.hpp>
#include <vector>

#include "servocal/core/observation.h"

namespace servocal::openni2 {

/// The pixel formats that we read of a stream, the best one first.
const std::vector<openni::PixelFormat>& formatsOf(Stream stream);
const char* nameOf(openni::PixelFormat format);

/// Pixels as sensor::Frame has them: color BGR or gray, infrared as it comes, depth in mm. Always a copy.
/// `data` has `height` rows, `stride` bytes apart.
cv::Mat imageOf(openni::PixelFormat format, int width, int height, int stride, const void* data);

}  // namespace servocal::openni2
