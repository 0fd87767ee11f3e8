// SPDX-License-Identifier: GPL-3.0-or-later
#include "depth_kernels.h"

namespace servocal::sim {
namespace {

inline float larger(float a, float b) { return a > b ? a : b; }
inline float smaller(float a, float b) { return a < b ? a : b; }

/// What both kinds of sensor share at one pixel.
struct Look {
  float depth;
  float sigma_m;
  bool valid;
};

inline Look look(const PlaneSeen& plane, const DepthQuality& q, float x, float y, float stretch) {
  const float inverse = plane.per_x * x + plane.per_y * y + plane.per_one;
  const float depth = 1.0F / inverse;
  const float cosine = plane.distance * inverse / stretch;
  const float off_m = depth - 0.4F;
  const float axial = q.noise_m + q.noise_per_m2 * off_m * off_m;
  // Less light comes back from the side and from an oblique surface.
  const float sigma_m = axial * (1.0F + 0.5F * (x * x + y * y)) / larger(cosine, 0.2F);
  const bool valid = (inverse > 0.0F) & (depth >= q.nearest_m) & (depth <= q.farthest_m) &
                     (cosine >= q.least_cosine) & (cosine <= q.highlight_cosine);
  return {depth, sigma_m, valid};
}

inline float gain(float range_m) { return 1.0F + 0.2F * (range_m - 1.0F); }  // DepthErrors::fieldGain

}  // namespace

void measureRange(const PlaneSeen& plane, const DepthRow& row, const DepthQuality& quality,
                  const RangeTable& table, float* __restrict signal, float* __restrict sigma) {
  const DepthQuality q = quality;
  for (int i = 0; i < row.count; ++i) {
    const float stretch = row.stretch[i];
    const Look seen = look(plane, q, row.ray_x[i], row.ray_y[i], stretch);
    const float range = seen.depth * stretch;
    const float place =
        smaller(larger(range * (1.0F / kRangeStepM), 0.0F), static_cast<float>(table.size - 2));
    const int step = static_cast<int>(place);
    const float error = table.error_m[step] +
                        (place - static_cast<float>(step)) * (table.error_m[step + 1] - table.error_m[step]);
    const float error_m = error + row.field[i] * gain(range) + table.black_m * row.darkness[i];
    const float measured_m = seen.depth + error_m / stretch + q.fixed * seen.sigma_m * row.pattern[i];
    signal[i] = seen.valid ? 1000.0F * measured_m : kNoSignal;
    sigma[i] = seen.valid ? 1000.0F * q.temporal * seen.sigma_m : 0.0F;
  }
}

void measureDisparity(const PlaneSeen& plane, const DepthRow& row, const DepthQuality& quality,
                      const DisparityScale& scale, float* __restrict signal, float* __restrict sigma) {
  const DepthQuality q = quality;
  const DisparityScale s = scale;
  for (int i = 0; i < row.count; ++i) {
    const Look seen = look(plane, q, row.ray_x[i], row.ray_y[i], row.stretch[i]);
    const float steps = s.focal_baseline / seen.depth;
    const float steps_per_m = steps / seen.depth;
    const float sigma_steps = seen.sigma_m * steps_per_m;
    const float measured =
        steps * s.scale + s.offset + row.field[i] * gain(seen.depth) + q.fixed * sigma_steps * row.pattern[i];
    signal[i] = seen.valid ? measured : kNoSignal;
    sigma[i] = seen.valid ? q.temporal * sigma_steps : 0.0F;
  }
}

void writeRange(int count, const float* __restrict signal, const float* __restrict sigma,
                const std::int8_t* __restrict noise, float unit, std::uint16_t* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const float value = (signal[i] + sigma[i] * (1.0F / 32.0F) * static_cast<float>(noise[i])) * unit + 0.5F;
    out[i] = static_cast<std::uint16_t>(static_cast<int>(smaller(larger(value, 0.0F), 65535.0F)));
  }
}

void writeDisparity(int count, const float* __restrict signal, const float* __restrict sigma,
                    const std::int8_t* __restrict noise, const std::uint16_t* __restrict depth_of, int size,
                    std::uint16_t* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const float value = signal[i] + sigma[i] * (1.0F / 32.0F) * static_cast<float>(noise[i]) + 0.5F;
    const int step = static_cast<int>(smaller(larger(value, 0.0F), static_cast<float>(size - 1)));
    out[i] = depth_of[step];
  }
}

}  // namespace servocal::sim
