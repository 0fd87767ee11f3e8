// SPDX-License-Identifier: GPL-3.0-or-later
#include "sensor_noise.h"

#include <algorithm>
#include <cmath>

namespace servocal::sim {
namespace {

constexpr double kGrainSigmaPx = 0.6;

std::vector<float> whiteTile(int size) {
  Random random(20161, "sensor noise tile");
  std::vector<float> tile(static_cast<std::size_t>(size) * size);
  for (float& value : tile) value = static_cast<float>(random.normal());
  return tile;
}

// Periodic 5-tap Gaussian along `stride`, scaled to keep unit variance.
std::vector<float> smoothed(const std::vector<float>& in, int size, bool along_rows) {
  std::array<float, 5> taps;
  float power = 0.0F;
  for (int k = 0; k < 5; ++k) {
    taps[k] = static_cast<float>(std::exp(-0.5 * (k - 2) * (k - 2) / (kGrainSigmaPx * kGrainSigmaPx)));
    power += taps[k] * taps[k];
  }
  for (float& tap : taps) tap /= std::sqrt(power);
  std::vector<float> out(in.size());
  for (int v = 0; v < size; ++v) {
    for (int u = 0; u < size; ++u) {
      float sum = 0.0F;
      for (int k = 0; k < 5; ++k) {
        const int uu = along_rows ? (u + k - 2 + size) % size : u;
        const int vv = along_rows ? v : (v + k - 2 + size) % size;
        sum += taps[k] * in[static_cast<std::size_t>(vv) * size + uu];
      }
      out[static_cast<std::size_t>(v) * size + u] = sum;
    }
  }
  return out;
}

std::shared_ptr<const std::vector<std::int8_t>> makeTile(int size, int width) {
  const std::vector<float> noise = smoothed(smoothed(whiteTile(size), size, true), size, false);
  auto tile = std::make_shared<std::vector<std::int8_t>>(static_cast<std::size_t>(size) * width);
  for (int v = 0; v < size; ++v) {
    for (int u = 0; u < width; ++u) {
      const float value = noise[static_cast<std::size_t>(v) * size + u % size] * SensorNoise::kUnit;
      (*tile)[static_cast<std::size_t>(v) * width + u] =
          static_cast<std::int8_t>(std::lround(std::clamp(value, -127.0F, 127.0F)));
    }
  }
  return tile;
}

}  // namespace

SensorNoise::SensorNoise(double noise_gray) : noise_gray_(noise_gray) {
  static const auto tile = makeTile(kTile, kTile + kMaxWidthPx);
  tile_ = tile;
}

void SensorNoise::shuffle(Random& random) {
  offset_u_ = random.integer(0, kTile - 1);
  offset_v_ = random.integer(0, kTile - 1);
}

const std::int8_t* SensorNoise::row(int u, int v) const {
  const std::size_t row = static_cast<std::size_t>((v + offset_v_) & (kTile - 1));
  return tile_->data() + row * (kTile + kMaxWidthPx) + offset_u_ + u;
}

std::uint8_t SensorNoise::sigmaEighths(double gray) const {
  const double sigma = noise_gray_ * std::sqrt(0.3 + 0.7 * std::max(gray, 0.0) / 128.0);
  return static_cast<std::uint8_t>(std::min(255L, std::lround(8.0 * sigma)));
}

}  // namespace servocal::sim
