// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>

namespace servocal::board {

/// Cells of a tag, border included, as printed upright: CV_8UC1, 0 black, 255 white.
/// @throws std::invalid_argument if the family is unknown or the code is not in it.
cv::Mat tagCells(const std::string& family, int code, int border_bits);

/// Number of an OpenCV dictionary ("aruco_6x6_250" is cv::aruco::DICT_6X6_250).
/// @throws std::invalid_argument if there is no such dictionary.
int arucoDictionary(const std::string& name);

}  // namespace servocal::board
