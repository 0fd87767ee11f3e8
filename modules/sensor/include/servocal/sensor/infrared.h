// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>

namespace servocal::sensor {

/// An infrared image of 16 bits (CV_16UC1: ten bits of a Kinect v1, sixteen of a v2) as detectors want it,
/// CV_8UC1.
///
/// Linear, so that no edge moves. The gain makes the 99.5th percentile at most 230, in steps of 2^(1/4):
/// images of the same scene get the same gain. What is brighter than 255 saturates.
///
/// @throws std::invalid_argument unless `counts` is CV_16UC1 with pixels.
cv::Mat infraredToEightBits(const cv::Mat& counts);

}  // namespace servocal::sensor
