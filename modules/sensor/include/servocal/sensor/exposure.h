// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

namespace servocal::sensor {

/// Why nothing can be found in an image: half a sentence for the operator if it is almost black or mostly
/// saturated; nothing if its exposure is of some use, or it is not of 8 bits (what is white there depends on
/// the camera).
///
/// Almost black: hardly a pixel above 10 % of white. Mostly saturated: half the pixels are white to 2 %.
/// Between the two an image may still be too dark or bright just where the board is.
///
/// @param image CV_8UC1 or CV_8UC3.
/// @throws std::invalid_argument if it is empty.
std::optional<std::string> exposureTrouble(const cv::Mat& image);

}  // namespace servocal::sensor
