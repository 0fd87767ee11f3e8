// SPDX-License-Identifier: GPL-3.0-or-later
// The inner loops of rendering, on plain arrays so that the compiler vectorizes them. Their file
// may be compiled for a newer processor than the rest; hence no inline code shared with other files.
#pragma once

#include <cstdint>

namespace servocal::sim {

/// A board's printed pattern in units of squares, origin at the upper left of the squares.
struct BoardPattern {
  float from_ray[9];  ///< Takes a ray (x, y, 1) to (u, v, 1) up to scale, row by row.
  float squares_x, squares_y;
  float margin;
  float hollow_low, hollow_high;  ///< White inside of the first square; equal if none.
  float white, black, plate;      ///< Gray in full light; `plate` is the rim's.
};

/// Any other print: how much of it is ink, summed up. Units are texels, origin at the plate's upper left.
struct InkPattern {
  float from_ray[9];             ///< As BoardPattern's.
  const std::int32_t* integral;  ///< (height + 1) x (width + 1); ink from the origin to a texel's upper left,
                                 ///< 255 per black texel.
  int width, height;             ///< Of the plate.
  const std::uint8_t* tone;      ///< height x width: 0 or 255 where all within `reach` is white or black.
  float reach;                   ///< texels
  float white, black;
};

/// A stretch of one row. The light and the pixel's footprint vary smoothly and come precomputed.
struct BoardRow {
  int count;
  const float* ray_x;
  const float* ray_y;
  const float* footprint_u;  ///< Size of a pixel on the board along u, in the pattern's unit.
  const float* footprint_v;
  const float* light;        ///< Factor on the gray.
  const float* highlight;    ///< Gray added.
};

/// Adds `weight` times the board to `color` (premultiplied) and its coverage to `alpha`. The pattern is
/// integrated over each pixel in closed form: by a box in u and v with the variance of the pixel's
/// parallelogram.
void addBoardRow(const BoardPattern& pattern, const BoardRow& row, float weight, float* color,
                 float* alpha);
void addBoardRow(const InkPattern& pattern, const BoardRow& row, float weight, float* color, float* alpha);

/// gray32: 32 times the gray value. sigma8: 8 times its noise. noise: standard deviation 32.
void writeBackgroundRow(int count, const std::int16_t* gray32, const std::uint8_t* sigma8,
                        const std::int8_t* noise, std::uint8_t* out);

/// Blends `gray` into gray32 where `cover` (of 255) says so.
void blendRow(int count, const std::uint8_t* gray, const std::uint8_t* cover, std::int16_t* gray32);

/// Lays the (blurred) board over the background and adds noise.
void writeBoardRow(int count, const float* color, const float* alpha, const std::int16_t* gray32,
                   const std::int8_t* noise, float noise_gray, std::uint8_t* out);

}  // namespace servocal::sim
