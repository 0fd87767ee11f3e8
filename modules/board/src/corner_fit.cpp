// SPDX-License-Identifier: GPL-3.0-or-later
#include "corner_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "error_function.h"
#include "normal_sums.h"

namespace servocal::board {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

// Brightness across parallel edges `apart` from each other: -1 and 1 in turn, blurred.
struct Profile {
  double value, slope;  // Slope by distance in units of blur.
  double spread;        // -slope by the logarithm of blur; t * slope for a single edge.
  double curl;          // (t^2 - 1) * slope for a single edge.
};

Profile profile(const ErrorFunction& error_function, double t, double apart) {
  Profile result;
  error_function.at(t, result.value, result.slope);
  result.spread = t * result.slope;
  result.curl = (t * t - 1) * result.slope;
  if (apart - std::abs(t) < 4.0) {
    // The next edges show through.
    for (const double next : {t - apart, t + apart}) {
      double value, slope;
      error_function.at(next, value, slope);
      result.value -= value;
      result.slope -= slope;
      result.spread -= next * slope;
      result.curl -= (next * next - 1) * slope;
    }
  }
  return result;
}

// Brightness where two families of edges cross, and its slopes by the two distances. Blur across one edge moves
// the other as well unless they are at right angles: the mean of a product of two signs whose arguments are
// normal with correlation rho, as a series in rho (the tetrachoric series, Pearson 1900), to its third power.
struct Crossing {
  double value, by_first, by_second;
};

Crossing cross(const Profile& first, const Profile& second, double rho) {
  const double half = 0.5 * rho * rho, sixth = rho * half / 3.0;
  return {first.value * second.value + rho * first.slope * second.slope + half * first.spread * second.spread +
              sixth * first.curl * second.curl,
          first.slope * second.value - rho * first.spread * second.slope - half * first.curl * second.spread,
          first.value * second.slope - rho * first.slope * second.spread - half * first.spread * second.curl};
}

// What a pixel shows on average whose brightness, with noise, is cut off at white, and the slope by brightness (the mean
// of a censored normal).
struct Clipped {
  double gray, slope;
};

constexpr double kWhite = 255.0;
constexpr double kClipNoise = 5.0;  // gray levels; only how softly the cut begins.

Clipped clip(const ErrorFunction& error_function, double brightness) {
  const double room = (kWhite - brightness) / kClipNoise;
  if (room > 4.0) return {brightness, 1.0};
  double value, slope;
  error_function.at(room, value, slope);
  const double below = 0.5 * (1.0 + value);  // How often it is not cut off.
  return {kWhite - kClipNoise * (0.5 * slope + room * below), below};
}

struct Sample {
  double x, y;  // From the guess, px.
  double gray;
};

constexpr double kMaxHalf = 16.0;     // px; more costs time and adds little.
constexpr double kMaxHalfFirst = 7.0;  // px; enough for the blur, and faster.
constexpr double kMinBlur = 0.35;    // px; a pixel's own extent.
constexpr double kMaxBlur = 8.0;     // px
constexpr double kHighlight = 0.5;   // gray levels per px; a board's highlight beside what a lamp does alone.

// The pixels near the two edges, inside the window.
bool collect(const cv::Mat& gray, const CornerGuess& guess, const Vector2d& normal_u, const Vector2d& normal_v,
             std::vector<Sample>& samples) {
  const Vector2d along_u = guess.axes.col(0);
  const Vector2d along_v = guess.axes.col(1);
  const double apart_u = std::abs(normal_u.dot(along_v));  // Between edges along u, px.
  const double apart_v = std::abs(normal_v.dot(along_u));
  const double max_half = guess.fit_blur ? kMaxHalfFirst : kMaxHalf;
  const auto half = [&](double apart, double length) {
    return std::min(std::max(0.45, std::min(0.55, 1.3 / apart)), max_half / length);
  };
  const double half_u = half(apart_v, along_u.norm());
  const double half_v = half(apart_u, along_v.norm());
  const double band_u = 3.0 * guess.blur_px.x() + 0.7;
  const double band_v = 3.0 * guess.blur_px.y() + 0.7;

  const Matrix2d to_grid = guess.axes.inverse();
  const double reach_x = half_u * std::abs(along_u.x()) + half_v * std::abs(along_v.x());
  const double reach_y = half_u * std::abs(along_u.y()) + half_v * std::abs(along_v.y());
  const int x0 = static_cast<int>(std::ceil(guess.pixel.x() - reach_x));
  const int x1 = static_cast<int>(std::floor(guess.pixel.x() + reach_x));
  const int y0 = static_cast<int>(std::ceil(guess.pixel.y() - reach_y));
  const int y1 = static_cast<int>(std::floor(guess.pixel.y() + reach_y));
  if (x0 < 0 || y0 < 0 || x1 >= gray.cols || y1 >= gray.rows) return false;

  // Nearer than this to both inner sides of the hollow square, its white shows through the blur.
  const double hollow_u = guess.hollow_start - 2.2 * guess.blur_px.y() / apart_v;
  const double hollow_v = guess.hollow_start - 2.2 * guess.blur_px.x() / apart_u;
  samples.clear();
  for (int y = y0; y <= y1; ++y) {
    const uchar* row = gray.ptr<uchar>(y);
    const double dy = y - guess.pixel.y();
    for (int x = x0; x <= x1; ++x) {
      const double dx = x - guess.pixel.x();
      const double u = to_grid(0, 0) * dx + to_grid(0, 1) * dy;
      const double v = to_grid(1, 0) * dx + to_grid(1, 1) * dy;
      if (std::abs(u) > half_u || std::abs(v) > half_v) continue;
      if (std::abs(v) * apart_u > band_u && std::abs(u) * apart_v > band_v) continue;
      const double in_u = guess.hollow_quadrant.x() * u, in_v = guess.hollow_quadrant.y() * v;
      if (guess.hollow_quadrant.x() != 0 &&
          ((in_u > hollow_u && in_v > hollow_v) ||
           (guess.hollow_opposite && -in_u > hollow_u && -in_v > hollow_v)))
        continue;
      samples.push_back({dx, dy, static_cast<double>(row[x])});
    }
  }
  return samples.size() >= 9;
}

}  // namespace

std::optional<CornerFit> fitCorner(const cv::Mat& gray, const CornerGuess& guess) {
  static const ErrorFunction error_function;
  thread_local std::vector<Sample> samples;
  // Unit normals of the edges, towards growing v and growing u.
  Vector2d normal_u(-guess.axes(1, 0), guess.axes(0, 0));
  Vector2d normal_v(guess.axes(1, 1), -guess.axes(0, 1));
  normal_u.normalize();
  normal_v.normalize();
  if (guess.axes.determinant() <= 0.0) return std::nullopt;  // A mirror image, or degenerate.
  const double apart_u = std::abs(normal_u.dot(guess.axes.col(1)));  // Between edges along u, px.
  const double apart_v = std::abs(normal_v.dot(guess.axes.col(0)));
  if (!collect(gray, guess, normal_u, normal_v, samples)) return std::nullopt;

  const bool clips = std::any_of(samples.begin(), samples.end(), [](const Sample& s) { return s.gray >= kWhite; });

  // Parameters: position (2), level, step, gradient of the level (2), and the two blurs or, if they are known, the
  // gradient of the step (2). A lamp's gradient is the same part of both; a highlight adds to the level alone.
  constexpr int kMost = NormalSums::kMost;
  using Normal = Eigen::Matrix<double, kMost, kMost>;
  using Vector = Eigen::Matrix<double, kMost, 1>;
  Vector2d position = Vector2d::Zero();
  Vector2d blur = guess.blur_px.cwiseMax(kMinBlur);
  const Vector2d half_bend = 0.5 * guess.bend;
  double level = 0.0, step = 0.0;
  Vector2d level_gradient = Vector2d::Zero(), step_gradient = Vector2d::Zero();  // gray/px
  const double radius = 0.25 * std::min(guess.axes.col(0).norm(), guess.axes.col(1).norm());
  const double max_shift = std::max(1.5, radius);

  // Correlation of the blur across the two edges.
  const auto correlation = [&] {
    const double rho =
        normal_u.dot(normal_v) * 0.5 * (blur.x() / blur.y() + blur.y() / blur.x());
    return std::clamp(rho, -0.95, 0.95);
  };

  // Level and step by linear regression at the guess.
  {
    double n = 0, s1 = 0, s2 = 0, g1 = 0, gs = 0;
    for (const Sample& sample : samples) {
      const double t1 = (normal_u.x() * sample.x + normal_u.y() * sample.y) / blur.x();
      const double t2 = (normal_v.x() * sample.x + normal_v.y() * sample.y) / blur.y();
      const double s = cross(profile(error_function, t1, apart_u / blur.x()),
                             profile(error_function, t2, apart_v / blur.y()), correlation())
                           .value;
      n += 1, s1 += s, s2 += s * s, g1 += sample.gray, gs += sample.gray * s;
    }
    const double det = n * s2 - s1 * s1;
    if (det <= 1e-9) return std::nullopt;
    step = (n * gs - s1 * g1) / det;
    level = (g1 - step * s1) / n;
  }
  if (std::abs(step) < 2.0) return std::nullopt;

  thread_local NormalSums sums;
  Normal normal;
  double residual = 0.0;
  const int most_iterations = clips ? 10 : guess.fit_blur ? 6 : 5;
  for (int iteration = 0;; ++iteration) {
    sums.reset(kMost, samples.size());
    double squares = 0.0, pixels = 0.0;  // Those that are not cut off count.
    const double inverse_u = 1.0 / blur.x();
    const double inverse_v = 1.0 / blur.y();
    const double rho = correlation();
    const double lamp = step / std::max(level, std::abs(step));
    if (guess.fit_blur) step_gradient = lamp * level_gradient;
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const Sample& sample = samples[k];
      const double dx = sample.x - position.x();
      const double dy = sample.y - position.y();
      const double d1 = normal_u.x() * dx + normal_u.y() * dy, d2 = normal_v.x() * dx + normal_v.y() * dy;
      const double s1 = normal_u.y() * dx - normal_u.x() * dy, s2 = normal_v.y() * dx - normal_v.x() * dy;
      const double t1 = (d1 - half_bend.x() * s1 * s1) * inverse_u;
      const double t2 = (d2 - half_bend.y() * s2 * s2) * inverse_v;
      const Profile p1 = profile(error_function, t1, apart_u * inverse_u);
      const Profile p2 = profile(error_function, t2, apart_v * inverse_v);
      const Crossing crossing = cross(p1, p2, rho);
      const double s = crossing.value;
      const double level_here = level + level_gradient.x() * sample.x + level_gradient.y() * sample.y;
      const double step_here = step + step_gradient.x() * sample.x + step_gradient.y() * sample.y;
      const double brightness = level_here + step_here * s;
      const Clipped shown = clips ? clip(error_function, brightness) : Clipped{brightness, 1.0};
      const double error = sample.gray - shown.gray;
      squares += error * error;
      pixels += shown.slope;
      const double by_d1 = shown.slope * step_here * crossing.by_first;  // Per unit of t1.
      const double by_d2 = shown.slope * step_here * crossing.by_second;
      const auto set = [&](int parameter, double value) {
        sums.derivative(parameter, k) = static_cast<float>(value);
      };
      set(0, -(by_d1 * inverse_u * normal_u.x() + by_d2 * inverse_v * normal_v.x()));
      set(1, -(by_d1 * inverse_u * normal_u.y() + by_d2 * inverse_v * normal_v.y()));
      const double by_level = shown.slope, by_step = shown.slope * s;
      set(2, by_level);
      set(3, by_step);
      if (guess.fit_blur) {
        set(4, (by_level + lamp * by_step) * sample.x);
        set(5, (by_level + lamp * by_step) * sample.y);
        set(6, -shown.slope * step_here * p1.spread * p2.value * inverse_u);
        set(7, -shown.slope * step_here * p1.value * p2.spread * inverse_v);
      } else {
        set(4, by_level * sample.x);
        set(5, by_level * sample.y);
        set(6, by_step * sample.x);
        set(7, by_step * sample.y);
      }
      sums.error(k) = static_cast<float>(error);
    }
    normal.setZero();
    Vector right = Vector::Zero();
    sums.sum(normal, right);
    residual = std::sqrt(squares / std::max(pixels - kMost, 4.0));
    if (iteration == most_iterations) break;
    // A little damping of what small windows leave undetermined: blur and light.
    const auto damp = [&](int parameter, double weight, double from) {
      normal(parameter, parameter) += weight;
      right[parameter] -= weight * from;
    };
    for (int k = 0; k < 2; ++k) {
      damp(4 + k, 1e-2 * samples.size(), level_gradient[k]);
      if (guess.fit_blur) {
        damp(6 + k, 0.04 * step * step, blur[k] - guess.blur_px[k]);
      } else {
        // Against a highlight of any strength: step gradient - lamp * level gradient is about zero.
        const double weight = std::pow(residual / kHighlight, 2);
        const double beside = step_gradient[k] - lamp * level_gradient[k];
        damp(6 + k, weight, beside);
        damp(4 + k, weight * lamp * lamp, -beside / lamp);
        normal(6 + k, 4 + k) -= weight * lamp;
      }
    }
    const Vector change = normal.selfadjointView<Eigen::Lower>().ldlt().solve(right);
    if (!change.allFinite()) return std::nullopt;
    Vector2d move = change.head<2>();
    if (move.norm() > 1.0) move *= 1.0 / move.norm();
    position += move;
    level += change[2];
    step += change[3];
    level_gradient += change.segment<2>(4);
    if (!guess.fit_blur) step_gradient += change.tail<2>();
    bool settled = move.norm() < (guess.fit_blur ? 1e-2 : 2e-3) && iteration >= 1;
    if (guess.fit_blur) {
      for (int k = 0; k < 2; ++k) {
        settled = settled && std::abs(change[6 + k]) < 0.03 * blur[k];
        blur[k] = std::clamp(blur[k] + change[6 + k], std::max(kMinBlur, 0.6 * blur[k]),
                             std::min(kMaxBlur, 1.6 * blur[k]));
      }
    }
    if (position.norm() > max_shift) return std::nullopt;
    if (settled) break;
  }

  // Information on the position once the other parameters have taken theirs.
  const Normal full = normal.selfadjointView<Eigen::Lower>();
  const int others = guess.fit_blur ? 4 : 6;
  const auto mixed = full.block(0, 2, 2, others);
  CornerFit fit;
  // Where contrast is uneven, blur moves the pattern towards less of it: blur(contrast * pattern) is contrast *
  // blur(pattern), moved by the blur's variance times the relative gradient, to first order.
  const Vector2d uneven = step_gradient / (step + step_gradient.dot(position));
  fit.pixel = guess.pixel + position + 0.5 * blur.squaredNorm() * uneven;
  fit.structure = full.block<2, 2>(0, 0) - mixed * full.block(2, 2, others, others).ldlt().solve(mixed.transpose());
  fit.step = step;
  fit.residual = residual;
  fit.blur_px = blur;
  fit.pixels = static_cast<int>(samples.size());
  if (!fit.structure.allFinite() || fit.structure.determinant() <= 0.0) return std::nullopt;
  return fit;
}

}  // namespace servocal::board
