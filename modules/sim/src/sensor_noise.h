// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "random.h"

namespace servocal::sim {

/// Image noise, cheap enough for every pixel of every frame: a periodic tile of Gaussian noise, computed
/// once, laid over each frame at a random offset. Its grain is about a pixel and a half wide, as a
/// demosaiced and compressed color image has it: neighbouring pixels err alike.
///
/// The standard deviation grows with the signal: sigma(g)^2 = noise_gray^2 (0.3 + 0.7 g / 128).
class SensorNoise {
 public:
  explicit SensorNoise(double noise_gray);

  /// Starts a frame.
  void shuffle(Random& random);
  /// `count` samples of the frame's noise from pixel (u, v) on, standard deviation kUnit.
  /// Copies nothing: the tile's rows are long enough for a whole image row.
  const std::int8_t* row(int u, int v) const;

  /// Standard deviation at a gray value, 1/8 gray.
  std::uint8_t sigmaEighths(double gray) const;

  static constexpr int kUnit = 32;
  static constexpr int kMaxWidthPx = 4096;

 private:
  static constexpr int kTile = 1024;  // A power of two.
  double noise_gray_;
  int offset_u_ = 0;
  int offset_v_ = 0;
  std::shared_ptr<const std::vector<std::int8_t>> tile_;  // kTile rows of kTile + kMaxWidthPx.
};

}  // namespace servocal::sim
