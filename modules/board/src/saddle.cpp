// SPDX-License-Identifier: GPL-3.0-or-later
#include "saddle.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <opencv2/core/hal/intrin.hpp>
#include <optional>

namespace servocal::board {
namespace {

constexpr int kBorder = 4;        // Ring radius 3, plus one for derivatives.
constexpr int kMinResponse = 12;  // About 13 gray levels of contrast in a sharp image.
constexpr std::size_t kMaxPeaks =
    16000;  // Bounds the time spent on noise: a corner responds far more strongly.

struct Peak {
  int x, y, response;
};

// One row of the response, -det(Hessian) / 64 of the smoothed image, saturated to 16 bits.
void responseRow(const short* above, const short* row, const short* below, int width, short* out) {
  const auto scalar = [&](int x) {
    const int xx = row[x - 1] - 2 * row[x] + row[x + 1];
    const int yy = above[x] - 2 * row[x] + below[x];
    const int xy4 = below[x + 1] - below[x - 1] - above[x + 1] + above[x - 1];
    const int minus_det = xy4 * (xy4 >> 4) - xx * yy;
    return static_cast<short>(std::clamp(minus_det >> 6, -32768, 32767));
  };
  int x = kBorder;
#if CV_SIMD128
  using namespace cv;
  for (; x + 8 <= width - kBorder; x += 8) {
    const v_int16x8 centre = v_load(row + x);
    const v_int16x8 twice = v_shl<1>(centre);
    const v_int16x8 xx = v_load(row + x - 1) + v_load(row + x + 1) - twice;
    const v_int16x8 yy = v_load(above + x) + v_load(below + x) - twice;
    const v_int16x8 xy4 =
        v_load(below + x + 1) - v_load(below + x - 1) - v_load(above + x + 1) + v_load(above + x - 1);
    v_int16x8 left_lo, left_hi, right_lo, right_hi;
    v_zip(xy4, xx, left_lo, left_hi);
    v_zip(xy4 >> 4, v_setzero_s16() - yy, right_lo, right_hi);
    const v_int32x4 lo = v_dotprod(left_lo, right_lo) >> 6;
    const v_int32x4 hi = v_dotprod(left_hi, right_hi) >> 6;
    v_store(out + x, v_pack(lo, hi));
  }
#endif
  for (; x < width - kBorder; ++x) out[x] = scalar(x);
}

// Local maxima of the middle one of three response rows.
void peaksOfRow(const short* above, const short* row, const short* below, int width, int y,
                std::vector<Peak>& peaks) {
  const auto test = [&](int x) {
    const int value = row[x];
    if (value < kMinResponse) return;
    // Ties go to the later pixel, so that a plateau gives one peak.
    if (value < row[x - 1] || value <= row[x + 1]) return;
    for (int dx = -1; dx <= 1; ++dx)
      if (value < above[x + dx] || value <= below[x + dx]) return;
    peaks.push_back({x, y, value});
  };
  int x = kBorder;
#if CV_SIMD128
  using namespace cv;
  const v_int16x8 threshold = v_setall_s16(kMinResponse - 1);
  for (; x + 8 <= width - kBorder; x += 8) {
    const v_int16x8 value = v_load(row + x);
    v_int16x8 is_peak = value > threshold;
    if (!v_check_any(is_peak)) continue;
    is_peak = is_peak & (value >= v_load(row + x - 1)) & (value >= v_load(above + x)) &
              (value >= v_load(below + x));
    if (!v_check_any(is_peak)) continue;
    int bits = v_signmask(is_peak);
    while (bits) {
      const int k = __builtin_ctz(bits);
      bits &= bits - 1;
      test(x + k);
    }
  }
#endif
  for (; x < width - kBorder; ++x) test(x);
}

std::vector<Peak> findPeaks(const cv::Mat& smoothed) {
  const int width = smoothed.cols;
  const int height = smoothed.rows;
  std::vector<Peak> peaks;
  if (width < 2 * kBorder + 1 || height < 2 * kBorder + 3) return peaks;
  // Three rows of the response at a time stay in the cache. Columns outside the border stay zero.
  std::array<std::vector<short>, 3> rows;
  for (auto& row : rows) row.assign(width, 0);
  for (int y = kBorder; y < height - kBorder; ++y) {
    responseRow(smoothed.ptr<short>(y - 1), smoothed.ptr<short>(y), smoothed.ptr<short>(y + 1), width,
                rows[y % 3].data());
    if (y < kBorder + 2) continue;
    peaksOfRow(rows[(y - 2) % 3].data(), rows[(y - 1) % 3].data(), rows[y % 3].data(), width, y - 1, peaks);
  }
  if (peaks.size() > kMaxPeaks) {
    std::nth_element(peaks.begin(), peaks.begin() + kMaxPeaks, peaks.end(),
                     [](const Peak& a, const Peak& b) { return a.response > b.response; });
    peaks.resize(kMaxPeaks);
  }
  return peaks;
}

// A circle of integer offsets, the first half; the second half mirrors it.
struct Ring {
  int half;  // Number of offsets in half the circle.
  std::array<std::array<int, 2>, 8> at;
  std::array<float, 8> cos2, sin2;  // Of twice the angle.
  std::array<float, 8> weight;      // Share of half the circle; they sum to one.
};

Ring makeRing(std::vector<std::array<int, 2>> offsets) {
  Ring ring{};
  ring.half = static_cast<int>(offsets.size());
  for (int k = 0; k < ring.half; ++k) {
    ring.at[k] = offsets[k];
    const auto angle = [&](int index) {
      const int turns = index < 0 ? -1 : index / ring.half;
      const auto& o = offsets[(index + ring.half) % ring.half];
      return std::atan2(o[1], o[0]) + turns * M_PI;
    };
    ring.cos2[k] = static_cast<float>(std::cos(2 * angle(k)));
    ring.sin2[k] = static_cast<float>(std::sin(2 * angle(k)));
    ring.weight[k] = static_cast<float>((angle(k + 1) - angle(k - 1)) / (2 * M_PI));
  }
  return ring;
}

const Ring& largeRing() {
  static const Ring ring = makeRing({{3, 0}, {3, 1}, {2, 2}, {1, 3}, {0, 3}, {-1, 3}, {-2, 2}, {-3, 1}});
  return ring;
}

const Ring& smallRing() {
  static const Ring ring = makeRing({{2, 0}, {2, 1}, {1, 2}, {0, 2}, {-1, 2}, {-2, 1}});
  return ring;
}

// Fills rays, side and contrast if the ring around the peak shows four sectors.
bool verifyRing(const cv::Mat& smoothed, const Peak& peak, const Ring& ring, float least_contrast,
                Saddle& saddle) {
  const int stride = static_cast<int>(smoothed.step1());
  const short* centre = smoothed.ptr<short>(peak.y) + peak.x;
  const float middle = *centre;
  std::array<float, 8> even;
  float odd_energy = 0, even_energy = 0, mean = 0, c2 = 0, s2 = 0;
  float high = -1e9f, low = 1e9f;
  for (int k = 0; k < ring.half; ++k) {
    const int offset = ring.at[k][1] * stride + ring.at[k][0];
    const float a = centre[offset] - middle;
    const float b = centre[-offset] - middle;
    even[k] = 0.5f * (a + b);
    const float odd = 0.5f * (a - b);
    odd_energy += odd * odd;
    even_energy += even[k] * even[k];
    mean += ring.weight[k] * even[k];
    c2 += ring.weight[k] * even[k] * ring.cos2[k];
    s2 += ring.weight[k] * even[k] * ring.sin2[k];
    high = std::max({high, a, b});
    low = std::min({low, a, b});
  }
  const float contrast = high - low;
  if (contrast < least_contrast || odd_energy > 0.6f * even_energy) return false;
  if (high < 0.12f * contrast || low > -0.12f * contrast) return false;

  // Second harmonic: amplitude * cos(2 (angle - phase)) + mean is zero along the two edges. For a sharp
  // pattern of unequal sectors this is right too, to a degree.
  const float amplitude = 2.0f * std::hypot(c2, s2);
  if (std::abs(mean) > 0.97f * amplitude) return false;

  // Over half a turn exactly one bright and one dark arc; samples near the middle do not count.
  const float dead = 0.1f * contrast;
  int first = 0, last = 0, changes = 0;
  for (int k = 0; k < ring.half; ++k) {
    const int sign = even[k] > dead ? 1 : even[k] < -dead ? -1 : 0;
    if (sign == 0) continue;
    if (first == 0) first = sign;
    if (last != 0 && sign != last) ++changes;
    last = sign;
  }
  if (first == 0) return false;
  if (first != last) ++changes;
  if (changes != 2) return false;

  const float phase = 0.5f * std::atan2(s2, c2);
  const float half_bright = 0.5f * std::acos(std::clamp(-mean / amplitude, -1.0f, 1.0f));
  // Bright between phase - half_bright and phase + half_bright.
  float angle_a = phase - half_bright;
  float angle_b = phase + half_bright;
  const float pi = static_cast<float>(M_PI);
  const auto wrap = [&](float& angle) {
    while (angle < 0) angle += pi;
    while (angle >= pi) angle -= pi;
  };
  wrap(angle_a);
  wrap(angle_b);
  saddle.side = 1;  // Ray a has its bright sector towards larger angles.
  if (angle_a > angle_b) {
    std::swap(angle_a, angle_b);
    saddle.side = -1;
  }
  saddle.rays[0] = {std::cos(angle_a), std::sin(angle_a)};
  saddle.rays[1] = {std::cos(angle_b), std::sin(angle_b)};
  saddle.rays[2] = -saddle.rays[0];
  saddle.rays[3] = -saddle.rays[1];
  saddle.contrast = contrast;
  return true;
}

// Standard deviation of the noise in a smoothed image: median second difference of a sample of pixels.
float noise(const cv::Mat& smoothed) {
  std::vector<int> differences;
  for (int y = 3; y < smoothed.rows; y += 11) {
    const short* row = smoothed.ptr<short>(y);
    for (int x = 3 + y % 7; x + 3 < smoothed.cols; x += 17)
      differences.push_back(std::abs(row[x - 3] - 2 * row[x] + row[x + 3]));
  }
  if (differences.empty()) return 0.0f;
  const auto middle = differences.begin() + differences.size() / 2;
  std::nth_element(differences.begin(), middle, differences.end());
  return *middle / (0.6745f * std::sqrt(6.0f));
}

// The stationary point of the quadratic through the peak's neighborhood.
Eigen::Vector2f subpixel(const cv::Mat& smoothed, const Peak& peak) {
  const short* above = smoothed.ptr<short>(peak.y - 1) + peak.x;
  const short* row = smoothed.ptr<short>(peak.y) + peak.x;
  const short* below = smoothed.ptr<short>(peak.y + 1) + peak.x;
  const float gx = 0.5f * (row[1] - row[-1]);
  const float gy = 0.5f * (below[0] - above[0]);
  const float xx = row[-1] - 2.0f * row[0] + row[1];
  const float yy = above[0] - 2.0f * row[0] + below[0];
  const float xy = 0.25f * (below[1] - below[-1] - above[1] + above[-1]);
  const float det = xx * yy - xy * xy;
  float dx = -(yy * gx - xy * gy) / det;
  float dy = -(xx * gy - xy * gx) / det;
  dx = std::clamp(dx, -1.0f, 1.0f);
  dy = std::clamp(dy, -1.0f, 1.0f);
  return {peak.x + dx, peak.y + dy};
}

}  // namespace

cv::Mat smooth(const cv::Mat& gray) {
  const int width = gray.cols;
  const int height = gray.rows;
  cv::Mat smoothed(height, width, CV_16SC1);
  std::vector<short> column(width + 2);
  for (int y = 0; y < height; ++y) {
    const uchar* above = gray.ptr<uchar>(std::max(y - 1, 0));
    const uchar* row = gray.ptr<uchar>(y);
    const uchar* below = gray.ptr<uchar>(std::min(y + 1, height - 1));
    short* sum = column.data() + 1;
    int x = 0;
#if CV_SIMD128
    using namespace cv;
    for (; x + 8 <= width; x += 8) {
      const v_uint16x8 total =
          v_load_expand(above + x) + v_load_expand(below + x) + v_shl<1>(v_load_expand(row + x));
      v_store(sum + x, v_reinterpret_as_s16(total));
    }
#endif
    for (; x < width; ++x) sum[x] = static_cast<short>(above[x] + 2 * row[x] + below[x]);
    sum[-1] = sum[0];
    sum[width] = sum[width - 1];
    short* out = smoothed.ptr<short>(y);
    x = 0;
#if CV_SIMD128
    for (; x + 8 <= width; x += 8)
      v_store(out + x, v_load(sum + x - 1) + v_load(sum + x + 1) + v_shl<1>(v_load(sum + x)));
#endif
    for (; x < width; ++x) out[x] = static_cast<short>(sum[x - 1] + 2 * sum[x] + sum[x + 1]);
  }
  return smoothed;
}

std::vector<Saddle> findSaddles(const cv::Mat& smoothed) {
  std::vector<Saddle> saddles;
  const float least_contrast = std::max(16.0f * 8.0f, 5.0f * noise(smoothed));
  for (const Peak& peak : findPeaks(smoothed)) {
    Saddle saddle;
    saddle.response = peak.response;
    if (!verifyRing(smoothed, peak, largeRing(), least_contrast, saddle) &&
        !verifyRing(smoothed, peak, smallRing(), least_contrast, saddle))
      continue;
    saddle.pixel = subpixel(smoothed, peak);
    saddles.push_back(saddle);
  }
  return saddles;
}

}  // namespace servocal::board
