// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor/exposure.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <stdexcept>

namespace servocal::sensor {
namespace {

constexpr int kSamples = 200;        // per row and column: plenty for shares of the image
constexpr double kHardlyAny = 0.01;  // single bright pixels are noise, or a lamp
constexpr int kBlack = 26, kWhite = 250;

}  // namespace

std::optional<std::string> exposureTrouble(const cv::Mat& image) {
  if (image.empty()) throw std::invalid_argument("exposureTrouble: the image is empty");
  if (image.depth() != CV_8U) return std::nullopt;
  const int step_y = std::max(1, image.rows / kSamples), step_x = std::max(1, image.cols / kSamples);
  const int channels = image.channels(), green = channels == 3 ? 1 : 0;
  int samples = 0;
  std::array<int, 256> histogram{};
  for (int y = 0; y < image.rows; y += step_y) {
    const unsigned char* row = image.ptr(y);
    for (int x = 0; x < image.cols; x += step_x) {
      ++histogram[row[x * channels + green]];
      ++samples;
    }
  }
  int below = 0, gray = 0;
  while (below + histogram[gray] < (1.0 - kHardlyAny) * samples) below += histogram[gray++];
  int white = 0;
  for (int g = kWhite; g < 256; ++g) white += histogram[g];
  char text[160];
  if (gray < kBlack) {
    std::snprintf(text, sizeof text,
                  "its image is almost black (%d of 255 at most): is there light, and no cap on the lens?",
                  gray);
    return text;
  }
  if (2 * white >= samples) {
    std::snprintf(text, sizeof text,
                  "%d %% of its image is saturated: shorten the exposure, or take light away",
                  (100 * white + samples / 2) / samples);
    return text;
  }
  return std::nullopt;
}

}  // namespace servocal::sensor
