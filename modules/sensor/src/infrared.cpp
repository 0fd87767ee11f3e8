// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor/infrared.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <vector>

namespace servocal::sensor {

cv::Mat infraredToEightBits(const cv::Mat& counts) {
  if (counts.type() != CV_16UC1 || counts.empty()) {
    throw std::invalid_argument("infraredToEightBits: the image must be CV_16UC1");
  }
  constexpr double kWhite = 230.0, kBelowWhite = 0.995, kStepsPerOctave = 4.0;
  constexpr int kEvery = 4;  // pixels of every fourth row and column
  std::vector<std::uint16_t> sample;
  sample.reserve(counts.total() / (kEvery * kEvery) + 1);
  for (int row = 0; row < counts.rows; row += kEvery) {
    const auto* const pixels = counts.ptr<std::uint16_t>(row);
    for (int column = 0; column < counts.cols; column += kEvery) sample.push_back(pixels[column]);
  }
  const auto white =
      sample.begin() + static_cast<std::ptrdiff_t>(kBelowWhite * static_cast<double>(sample.size() - 1));
  std::nth_element(sample.begin(), white, sample.end());
  const double octaves = std::log2(kWhite / std::max<double>(1.0, *white));
  cv::Mat gray;
  counts.convertTo(gray, CV_8U, std::exp2(std::floor(kStepsPerOctave * octaves) / kStepsPerOctave));
  return gray;
}

}  // namespace servocal::sensor
