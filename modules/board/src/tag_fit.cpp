// SPDX-License-Identifier: GPL-3.0-or-later
#include "tag_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "error_function.h"
#include "sample.h"
#include "warp.h"

namespace servocal::board {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

constexpr double kMaxLength = 40.0;  // px of a side per line; longer, and a lens' curvature shows.
constexpr double kMinBand = 1.55;    // px beside a line; fewer may be a single row of pixels.
constexpr double kMinStep = 12.0;    // Gray levels between black and white.
constexpr double kMinBlur = 0.45, kMaxBlur = 8.0;  // px
constexpr double kClear = 2.3;  // Of blur: nearer than this, the cells of the code show through.
constexpr double kLeakPull = 0.5;
constexpr double kSaturated = 254.0, kBeyondWeight = 0.1;
constexpr double kLight = 0.004;   // Typical change of light along a line, of the half step per px.
constexpr double kFloorPx = 0.01;  // Below this, print and lens decide, not noise.

/// A line measured along a piece of a side. Its distance from the guess, towards the inside of the tag, is
/// offset + slope * (distance from `middle`, along the side).
struct Line {
  Vector2d middle, along, inwards;
  Matrix2d covariance;  // Of offset and slope.
  double blur, black, white;
};

/// Where, within `search` px, brightness falls most towards the inside, on the mean along a to b.
std::optional<double> steepest(const cv::Mat& gray, const Vector2d& a, const Vector2d& b,
                               const Vector2d& inwards, double search) {
  constexpr int kPlaces = 12;
  const int reach = static_cast<int>(std::ceil(search)) + 1;
  std::vector<double> profile;
  for (int shift = -reach; shift <= reach; ++shift) {
    double sum = 0;
    for (int k = 0; k < kPlaces; ++k) {
      const Vector2d p = a + (k + 0.5) / kPlaces * (b - a) + shift * inwards;
      if (!insideImage(gray, p)) return std::nullopt;
      sum += bilinear(gray, p);
    }
    profile.push_back(sum / kPlaces);
  }
  double best = 0.25 * kMinStep;
  std::optional<double> where;
  for (int k = 1; k + 1 < static_cast<int>(profile.size()); ++k) {
    const double fall = profile[k - 1] - profile[k + 1];
    if (fall <= best) continue;
    best = fall;
    where = k - reach;
  }
  return where;
}

struct Sample {
  double u, d;  // Along the line from its middle, and across it inwards, px.
  double gray;
};

/// The pixels within `band` px of the line through `middle`, up to `half` px along it either way.
void collect(const cv::Mat& gray, const Vector2d& middle, const Vector2d& along, const Vector2d& inwards,
             double half, double band, std::vector<Sample>& samples) {
  samples.clear();
  const Vector2d reach = half * along.cwiseAbs() + band * inwards.cwiseAbs();
  const int y0 = std::max(0, static_cast<int>(std::ceil(middle.y() - reach.y())));
  const int y1 = std::min(gray.rows - 1, static_cast<int>(std::floor(middle.y() + reach.y())));
  // Row by row, the pixels of the rectangle are an interval: where both conditions hold.
  const auto narrow = [](double slope, double at, double limit, double& low, double& high) {
    if (std::abs(slope) < 1e-9) {
      if (std::abs(at) > limit) high = low - 1;
      return;
    }
    const double one = (-limit - at) / slope, two = (limit - at) / slope;
    low = std::max(low, std::min(one, two));
    high = std::min(high, std::max(one, two));
  };
  for (int y = y0; y <= y1; ++y) {
    const double dy = y - middle.y();
    double low = std::max(-reach.x(), -middle.x()), high = std::min(reach.x(), gray.cols - 1 - middle.x());
    narrow(along.x(), along.y() * dy, half, low, high);
    narrow(inwards.x(), inwards.y() * dy, band, low, high);
    const uchar* row = gray.ptr<uchar>(y);
    const int x1 = static_cast<int>(std::floor(middle.x() + high));
    for (int x = static_cast<int>(std::ceil(middle.x() + low)); x <= x1; ++x) {
      const double dx = x - middle.x();
      samples.push_back({along.x() * dx + along.y() * dy, inwards.x() * dx + inwards.y() * dy,
                         static_cast<double>(row[x])});
    }
  }
}

/// Fits the line near a to b. `border`: width of the black border, px; `blur`: a first guess, px.
std::optional<Line> fitLine(const cv::Mat& gray, const Vector2d& a, const Vector2d& b, double border,
                            double blur, double max_shift) {
  static const ErrorFunction error_function;
  thread_local std::vector<Sample> samples;
  Line line;
  const double half = 0.5 * (b - a).norm();
  if (half < 1.5) return std::nullopt;
  line.middle = 0.5 * (a + b);
  line.along = (b - a) / (2 * half);
  const Vector2d start = line.middle;

  // Level, half step, offset, slope, blur, and light along the line: a highlight that fades would else pass
  // for a slope.
  constexpr int kCount = 6;
  using Vector = Eigen::Matrix<double, kCount, 1>;
  using Normal = Eigen::Matrix<double, kCount, kCount>;
  for (int pass = 0; pass < 3; ++pass) {
    line.inwards = Vector2d(-line.along.y(), line.along.x());
    const double band = std::max(kMinBand, std::min(3.0 * blur + 0.7, border - kClear * blur));
    collect(gray, line.middle, line.along, line.inwards, half, band, samples);
    if (samples.size() < 12) return std::nullopt;

    double n1 = 0, g1 = 0, n2 = 0, g2 = 0;
    for (const Sample& sample : samples) {
      if (sample.d < -0.33 * band) n1 += 1, g1 += sample.gray;
      if (sample.d > 0.33 * band) n2 += 1, g2 += sample.gray;
    }
    if (n1 < 3 || n2 < 3) return std::nullopt;
    double level = 0.5 * (g1 / n1 + g2 / n2), step = 0.5 * (g1 / n1 - g2 / n2);
    if (step < 0.25 * kMinStep) return std::nullopt;
    double offset = 0.0, slope = 0.0, light = 0.0;
    const double first_blur = blur;
    Normal normal;
    double variance = 0.0;
    for (int iteration = 0; iteration < 5; ++iteration) {
      normal.setZero();
      Vector right = Vector::Zero();
      double squares = 0.0;
      int used = 0;
      for (const Sample& sample : samples) {
        const double t = (sample.d - offset - slope * sample.u) / blur;
        double value, bell;
        error_function.at(t, value, bell);
        const double expected = level - step * value + light * sample.u;
        // What is brighter than the camera can show pulls at nothing, if it looks so; but where all of the
        // paper is as white as can be, its level must not drift.
        const bool beyond = expected >= kSaturated && sample.gray >= kSaturated;
        const double weight = beyond ? kBeyondWeight : 1.0;
        const double error = beyond ? 0.0 : sample.gray - expected;
        used += !beyond;
        squares += error * error;
        const double by_offset = step * bell / blur;
        const double j[kCount] = {1.0, -value, by_offset, by_offset * sample.u, by_offset * t, sample.u};
        for (int r = 0; r < kCount; ++r) {
          right[r] += j[r] * error;
          for (int c = 0; c <= r; ++c) normal(r, c) += weight * j[r] * j[c];
        }
      }
      variance = squares / std::max(used - kCount, 4);
      // A narrow band does not tell light along the line from a slope: it is believed to be small.
      const double light_weight = std::max(variance, 0.1) / std::pow(kLight * step, 2);
      normal(5, 5) += light_weight;
      right[5] -= light_weight * light;
      // A little damping of blur, which a narrow band does not determine.
      Normal damped = normal;
      damped(4, 4) += 0.04 * step * step;
      right[4] -= 0.04 * step * step * (blur - first_blur);
      const Vector change = damped.selfadjointView<Eigen::Lower>().ldlt().solve(right);
      if (!change.allFinite()) return std::nullopt;
      level += change[0];
      step += change[1];
      offset += std::clamp(change[2], -1.0, 1.0);
      slope += change[3];
      light += change[5];
      blur = std::clamp(blur + change[4], std::max(kMinBlur, 0.6 * blur), std::min(kMaxBlur, 1.6 * blur));
      if (std::abs(offset) + half * std::abs(slope) > max_shift + 1.0) return std::nullopt;
      if (std::abs(change[2]) < 2e-3 && std::abs(change[3]) * half < 2e-3) break;
    }
    // The new line, and again from there if the pixels around it are others.
    line.middle += offset * line.inwards;
    line.along = (line.along + slope * line.inwards).normalized();
    line.inwards = Vector2d(-line.along.y(), line.along.x());
    line.blur = blur;
    line.black = level - step;
    line.white = level + step;
    const Normal full = normal.selfadjointView<Eigen::Lower>();
    line.covariance = std::max(variance, 0.1) * full.inverse().block<2, 2>(2, 2);
    // Where the border is thin for its blur, the cells of the code show through at the band's inner end, as
    // much as this at most, and pull the line by about as much of the blur (measured on rendered tags).
    const double leak = std::erfc((border - band) / (blur * M_SQRT2));
    line.covariance(0, 0) += std::pow(kLeakPull * leak * blur, 2);
    if (2 * step < kMinStep || !line.covariance.allFinite()) return std::nullopt;
    if (std::abs(offset) + half * std::abs(slope) < 0.15) break;
  }
  if (std::abs((line.middle - start).dot(line.inwards)) > max_shift) return std::nullopt;
  return line;
}

/// Variance of the line's place beside p, px^2.
double varianceAt(const Line& line, const Vector2d& p) {
  const double u = (p - line.middle).dot(line.along);
  return line.covariance(0, 0) + 2 * u * line.covariance(0, 1) + u * u * line.covariance(1, 1);
}

}  // namespace

double shortestSide(const TagCorners& corners) {
  double shortest = (corners[0] - corners[3]).norm();
  for (int k = 0; k < 3; ++k) shortest = std::min(shortest, (corners[k] - corners[k + 1]).norm());
  return shortest;
}

std::optional<TagFit> fitTag(const cv::Mat& gray, const TagCorners& guess, int cells_across, int border_cells,
                             double search_px) {
  TagFit fit;
  std::array<Line, 4> before, after;  // The lines that end at a corner, and those that start there.
  double blur = std::clamp(0.25 * shortestSide(guess) / cells_across, 0.5, 1.0);
  for (int side = 0; side < 4; ++side) {
    Vector2d a = guess[side], b = guess[(side + 1) % 4];
    const Vector2d far = 0.5 * (guess[(side + 2) % 4] + guess[(side + 3) % 4]);
    const double length = (b - a).norm();
    const Vector2d along = (b - a) / length, inwards(-along.y(), along.x());
    const double cell = (far - a).dot(inwards) / cells_across;
    if (!(length > 4.0) || !(cell > 0.8)) return std::nullopt;
    if (search_px > 0) {
      const auto shift =
          steepest(gray, a + 0.2 * (b - a), b - 0.2 * (b - a), inwards, std::min(search_px, cell));
      if (!shift) return std::nullopt;
      a += *shift * inwards;
      b += *shift * inwards;
    }
    const double trim = std::min(std::max(2.2 * blur + 0.5, 0.06 * length), 0.25 * length);
    const double max_shift = std::max(1.0, 0.7 * cell);
    const auto piece = [&](double from, double to) {
      return fitLine(gray, a + from * along, a + to * along, border_cells * cell, blur, max_shift);
    };
    if (length - 2 * trim <= 1.3 * kMaxLength) {
      const auto line = piece(trim, length - trim);
      if (!line) return std::nullopt;
      after[side] = before[(side + 1) % 4] = *line;
    } else {
      const auto first = piece(trim, trim + kMaxLength);
      const auto last = piece(length - trim - kMaxLength, length - trim);
      if (!first || !last) return std::nullopt;
      after[side] = *first;
      before[(side + 1) % 4] = *last;
    }
    blur = after[side].blur;
    fit.black += 0.25 * after[side].black;
    fit.white += 0.25 * after[side].white;
  }
  for (int k = 0; k < 4; ++k) {
    Matrix2d normals;
    normals.row(0) = before[k].inwards;
    normals.row(1) = after[k].inwards;
    if (std::abs(normals.determinant()) < 0.1) return std::nullopt;  // Seen almost edge-on.
    const Matrix2d inverse = normals.inverse();
    fit.corners[k] =
        inverse * Vector2d(before[k].inwards.dot(before[k].middle), after[k].inwards.dot(after[k].middle));
    const Vector2d variance(varianceAt(before[k], fit.corners[k]), varianceAt(after[k], fit.corners[k]));
    fit.covariances_px2[k] =
        inverse * variance.asDiagonal() * inverse.transpose() + kFloorPx * kFloorPx * Matrix2d::Identity();
    if (!fit.corners[k].allFinite()) return std::nullopt;
  }
  return fit;
}

int wrongCells(const cv::Mat& gray, const TagFit& tag, const cv::Mat& cells) {
  const double n = cells.cols;
  const Eigen::Matrix3d homography =
      fitHomography({{0, 0}, {n, 0}, {n, n}, {0, n}}, {tag.corners.begin(), tag.corners.end()});
  const double threshold = 0.5 * (tag.black + tag.white);
  int wrong = 0;
  for (int y = 0; y < cells.rows; ++y) {
    for (int x = 0; x < cells.cols; ++x) {
      const Vector2d p = (homography * Eigen::Vector3d(x + 0.5, y + 0.5, 1)).hnormalized();
      const bool white = cells.at<uchar>(y, x) != 0;
      if (!insideImage(gray, p) || (bilinear(gray, p) > threshold) != white) ++wrong;
    }
  }
  return wrong;
}

}  // namespace servocal::board
