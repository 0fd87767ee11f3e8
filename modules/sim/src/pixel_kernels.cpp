// SPDX-License-Identifier: GPL-3.0-or-later
#include "pixel_kernels.h"

#include <cmath>
#include <cstddef>

namespace servocal::sim {
namespace {

inline float smaller(float a, float b) { return a < b ? a : b; }
inline float larger(float a, float b) { return a > b ? a : b; }
inline float clamped(float x, float low, float high) { return smaller(larger(x, low), high); }

// Part of a box of this width about x that lies in [low, high].
inline float covered(float x, float half, float per_width, float low, float high) {
  const float from = larger(x - half, low), to = smaller(x + half, high);
  return larger(to - from, 0.0F) * per_width;
}

// Integral from 0 to t >= 0 of the square wave that is +1 on [0, 1), -1 on [1, 2), ...
inline float triangle(float t) {
  const float phase = t - 2.0F * static_cast<float>(static_cast<int>(0.5F * t));
  return 1.0F - std::fabs(1.0F - phase);
}

// Box average of the square wave, zero outside [0, high].
inline float wave(float x, float half, float per_width, float high) {
  const float from = clamped(x - half, 0.0F, high), to = clamped(x + half, 0.0F, high);
  return (triangle(to) - triangle(from)) * per_width;
}

// A place along one side of the table: between two of its lines.
struct Place {
  int line;
  float beyond;  // Share of the way to the next line.
};

inline Place placeOf(float x, int size) {
  const float inside = clamped(x, 0.0F, static_cast<float>(size));
  const int line = static_cast<int>(smaller(inside, static_cast<float>(size - 1)));
  return {line, inside - static_cast<float>(line)};
}

// Ink between two columns, from the top to a line of the table: differences of sums, which unlike the sums
// themselves are small enough for a float.
inline float inkBetween(const std::int32_t* line, Place left, Place right) {
  const std::int32_t* a = line + left.line;
  const std::int32_t* b = line + right.line;
  return static_cast<float>(b[0] - a[0]) + right.beyond * static_cast<float>(b[1] - b[0]) -
         left.beyond * static_cast<float>(a[1] - a[0]);
}

// Ink in a box; linear inside a texel, so that the average comes out exact.
inline float inkIn(const InkPattern& p, float left, float right, float top, float bottom) {
  const Place from_x = placeOf(left, p.width), to_x = placeOf(right, p.width);
  const Place from_y = placeOf(top, p.height), to_y = placeOf(bottom, p.height);
  const std::ptrdiff_t stride = p.width + 1;
  const std::int32_t* upper = p.integral + from_y.line * stride;
  const std::int32_t* lower = p.integral + to_y.line * stride;
  const float upper0 = inkBetween(upper, from_x, to_x), upper1 = inkBetween(upper + stride, from_x, to_x);
  const float lower0 = inkBetween(lower, from_x, to_x), lower1 = inkBetween(lower + stride, from_x, to_x);
  return lower0 - upper0 + to_y.beyond * (lower1 - lower0) - from_y.beyond * (upper1 - upper0);
}

}  // namespace

void addBoardRow(const BoardPattern& pattern, const BoardRow& row, float weight,
                 float* __restrict color, float* __restrict alpha) {
  const BoardPattern p = pattern;
  const float* __restrict ray_x = row.ray_x;
  const float* __restrict ray_y = row.ray_y;
  const float* __restrict footprint_u = row.footprint_u;
  const float* __restrict footprint_v = row.footprint_v;
  const float* __restrict light = row.light;
  const float* __restrict highlight = row.highlight;
  const int count = row.count;
  for (int i = 0; i < count; ++i) {
    const float x = ray_x[i], y = ray_y[i];
    const float scale = 1.0F / (p.from_ray[6] * x + p.from_ray[7] * y + p.from_ray[8]);
    const float u = (p.from_ray[0] * x + p.from_ray[1] * y + p.from_ray[2]) * scale;
    const float v = (p.from_ray[3] * x + p.from_ray[4] * y + p.from_ray[5]) * scale;
    const float half_u = 0.5F * footprint_u[i], half_v = 0.5F * footprint_v[i];
    const float per_u = 1.0F / footprint_u[i], per_v = 1.0F / footprint_v[i];

    const float plate = covered(u, half_u, per_u, -p.margin, p.squares_x + p.margin) *
                        covered(v, half_v, per_v, -p.margin, p.squares_y + p.margin);
    const float squares = covered(u, half_u, per_u, 0.0F, p.squares_x) *
                          covered(v, half_v, per_v, 0.0F, p.squares_y);
    const float hollow = covered(u, half_u, per_u, p.hollow_low, p.hollow_high) *
                         covered(v, half_v, per_v, p.hollow_low, p.hollow_high);
    const float checker = wave(u, half_u, per_u, p.squares_x) * wave(v, half_v, per_v, p.squares_y);
    const float dark = 0.5F * (squares + checker) - hollow;
    const float gray = p.plate * (plate - squares) + p.white * squares + (p.black - p.white) * dark;
    color[i] += weight * (gray * light[i] + plate * highlight[i]);
    alpha[i] += weight * plate;
  }
}

void addBoardRow(const InkPattern& pattern, const BoardRow& row, float weight, float* __restrict color,
                 float* __restrict alpha) {
  const InkPattern p = pattern;
  const auto width = static_cast<float>(p.width), height = static_cast<float>(p.height);
  for (int i = 0; i < row.count; ++i) {
    const float x = row.ray_x[i], y = row.ray_y[i];
    const float scale = 1.0F / (p.from_ray[6] * x + p.from_ray[7] * y + p.from_ray[8]);
    const float u = (p.from_ray[0] * x + p.from_ray[1] * y + p.from_ray[2]) * scale;
    const float v = (p.from_ray[3] * x + p.from_ray[4] * y + p.from_ray[5]) * scale;
    const float half_u = 0.5F * row.footprint_u[i], half_v = 0.5F * row.footprint_v[i];
    const float per_u = 1.0F / row.footprint_u[i], per_v = 1.0F / row.footprint_v[i];
    const float plate = covered(u, half_u, per_u, 0.0F, width) * covered(v, half_v, per_v, 0.0F, height);
    if (!(plate > 0.0F)) continue;
    float dark = 0.0F;
    const auto column = static_cast<int>(clamped(u, 0.0F, width - 1.0F));
    const auto line = static_cast<int>(clamped(v, 0.0F, height - 1.0F));
    const std::uint8_t tone = p.tone[static_cast<std::ptrdiff_t>(line) * p.width + column];
    if ((tone == 0 || tone == 255) && larger(half_u, half_v) < p.reach - 1.0F) {
      dark = tone == 0 ? 0.0F : plate;
    } else {
      dark = inkIn(p, u - half_u, u + half_u, v - half_v, v + half_v) * (per_u * per_v / 255.0F);
    }
    const float gray = p.white * plate + (p.black - p.white) * dark;
    color[i] += weight * (gray * row.light[i] + plate * row.highlight[i]);
    alpha[i] += weight * plate;
  }
}

void writeBackgroundRow(int count, const std::int16_t* __restrict gray32,
                        const std::uint8_t* __restrict sigma8, const std::int8_t* __restrict noise,
                        std::uint8_t* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const auto deviation = static_cast<std::int16_t>(static_cast<std::int16_t>(noise[i]) *
                                                     static_cast<std::int16_t>(sigma8[i]));
    const auto value =
        static_cast<std::int16_t>((gray32[i] + static_cast<std::int16_t>(deviation >> 3) + 16) >> 5);
    const auto low = static_cast<std::int16_t>(value < 0 ? 0 : value);
    out[i] = static_cast<std::uint8_t>(low > 255 ? 255 : low);
  }
}

void blendRow(int count, const std::uint8_t* __restrict gray, const std::uint8_t* __restrict cover,
              std::int16_t* __restrict gray32) {
  for (int i = 0; i < count; ++i) {
    const int weight = cover[i] + (cover[i] >> 7);  // 0 to 256
    gray32[i] = static_cast<std::int16_t>(gray32[i] + (((32 * gray[i] - gray32[i]) * weight) >> 8));
  }
}

void writeBoardRow(int count, const float* __restrict color, const float* __restrict alpha,
                   const std::int16_t* __restrict gray32, const std::int8_t* __restrict noise,
                   float noise_gray, std::uint8_t* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const float gray = color[i] + (1.0F - alpha[i]) * (1.0F / 32.0F) * static_cast<float>(gray32[i]);
    const float lit = clamped(gray, 0.0F, 255.0F);
    const float sigma = noise_gray * std::sqrt(0.3F + (0.7F / 128.0F) * lit);
    const float value = gray + sigma * (1.0F / 32.0F) * static_cast<float>(noise[i]) + 0.5F;
    out[i] = static_cast<std::uint8_t>(static_cast<int>(clamped(value, 0.0F, 255.0F)));
  }
}

}  // namespace servocal::sim
