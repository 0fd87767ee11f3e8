// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

namespace servocal::sim {

/// An infrared image (CV_8UC1) as it is with a structured-light projector not blocked: light only in dots, which
/// shift along the rows by the disparity of what they fall on. `depth` (CV_16UC1) is the depth image of the same
/// exposure; where it has no value there are no dots.
/// @param focal_baseline  disparity times depth, in px times the unit of `depth`
cv::Mat withProjectorDots(const cv::Mat& image, const cv::Mat& depth, double focal_baseline, std::uint64_t seed);

}  // namespace servocal::sim
