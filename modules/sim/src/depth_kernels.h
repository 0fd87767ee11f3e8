// SPDX-License-Identifier: GPL-3.0-or-later
// The inner loops of the depth image; as pixel_kernels.h, on plain arrays and without shared inline code.
#pragma once

#include <cstdint>

namespace servocal::sim {

/// A plane as rays meet it: along the ray (x, y, 1) its depth is 1 / (per_x x + per_y y + per_one).
struct PlaneSeen {
  float per_x, per_y, per_one;
  float
      distance;  ///< Of the plane from the camera, m; cosine of incidence = distance * ray length / depth ...
};

/// How noise and validity depend on where a pixel looks.
struct DepthQuality {
  float noise_m, noise_per_m2;  ///< As SimulatedDepthConfig.
  float temporal, fixed;        ///< Shares of the standard deviation: of each frame, of all.
  float least_cosine;           ///< Steeper incidence measures nothing.
  float highlight_cosine;       ///< Nor does incidence straighter than this: the surface mirrors the light.
  float nearest_m, farthest_m;
};

/// Pixels of one row that look at one plane.
struct DepthRow {
  int count;
  const float* ray_x;
  const float* ray_y;
  const float* stretch;   ///< |(x, y, 1)|
  const float* field;     ///< DepthErrors::field: m, or steps of disparity.
  const float* pattern;   ///< Fixed noise of unit variance.
  const float* darkness;  ///< 0 on white, 1 on black.
};

/// Error along the ray, by range in steps of kRangeStepM from 0 on.
struct RangeTable {
  const float* error_m;
  int size;
  float black_m;  ///< Added where darkness is 1.
};
constexpr float kRangeStepM = 0.002F;

/// Disparity in quantisation steps: focal_baseline / depth * scale + offset.
struct DisparityScale {
  float focal_baseline;
  float scale;
  float offset;
};

/// What the pixels measure, before each frame's noise: mm along the axis for time of flight, steps of
/// disparity for structured light; kNoSignal where there is none. `sigma` is that noise's deviation.
void measureRange(const PlaneSeen& plane, const DepthRow& row, const DepthQuality& quality,
                  const RangeTable& table, float* signal, float* sigma);
void measureDisparity(const PlaneSeen& plane, const DepthRow& row, const DepthQuality& quality,
                      const DisparityScale& scale, float* signal, float* sigma);
constexpr float kNoSignal = -1e6F;

/// Adds noise (standard deviation 32) and rounds: values below 1 become 0. Values are multiplied by `unit`.
void writeRange(int count, const float* signal, const float* sigma, const std::int8_t* noise, float unit,
                std::uint16_t* out);
/// The same, through a table of `size` values by steps of disparity.
void writeDisparity(int count, const float* signal, const float* sigma, const std::int8_t* noise,
                    const std::uint16_t* depth_of, int size, std::uint16_t* out);

}  // namespace servocal::sim
