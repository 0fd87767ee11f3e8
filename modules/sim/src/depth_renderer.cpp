// SPDX-License-Identifier: GPL-3.0-or-later
#include "depth_renderer.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace servocal::sim {
namespace {

constexpr double kLeastCosine = 0.3;          // 72 degrees
constexpr double kSaturatedHighlight = 0.33;  // Strength of a highlight that drowns the signal.
constexpr double kHighlightExponent = 60.0;   // As BoardLayer's.
constexpr int kPatternGrainPx = 5;
constexpr int kDisparitySteps = 2048;  // 11 bits
// Both surfaces meet within the pixel, or the correlation window: nothing is measured.
constexpr double kEdgeBlurRangePx = 0.7;
constexpr double kEdgeBlurDisparityPx = 1.2;
constexpr float kAlone = 0.98F;  // Coverage from which on a surface has the pixel to itself.

PlaneSeen planeSeen(const Eigen::Vector3d& normal, const Eigen::Vector3d& point) {
  const double distance = normal.dot(point);
  const Eigen::Vector3d inverse = normal / distance;
  return {static_cast<float>(inverse.x()), static_cast<float>(inverse.y()), static_cast<float>(inverse.z()),
          static_cast<float>(std::abs(distance))};
}

// Pure coverage and print: 1 on white, 0 on black.
Light noLight() {
  Light light;
  light.towards_c = -Eigen::Vector3d::UnitZ();
  light.fall_per_px.setZero();
  light.diffuse = 0.0;
  return light;
}

// Smooth unit noise that stays.
cv::Mat drawPattern(int width_px, int height_px, Random& random) {
  cv::Mat coarse(height_px / kPatternGrainPx + 3, width_px / kPatternGrainPx + 3, CV_32FC1), fine;
  for (int v = 0; v < coarse.rows; ++v) {
    for (int u = 0; u < coarse.cols; ++u) coarse.at<float>(v, u) = static_cast<float>(random.normal());
  }
  cv::resize(coarse, fine, {width_px, height_px}, 0.0, 0.0, cv::INTER_CUBIC);
  cv::Scalar mean, deviation;
  cv::meanStdDev(fine, mean, deviation);
  return (fine - mean[0]) / deviation[0];
}

}  // namespace

DepthRenderer::DepthRenderer(const BoardSpec& board, const Lens& lens, const SimulatedDepthConfig& config,
                             const DepthErrors& errors, const Scene& scene, std::uint64_t pattern_seed)
    : lens_(lens), config_(config), errors_(errors), scene_(scene), rays_(lens),
      layer_(board, lens, rays_, noLight(), {1.0, scene.black_shows ? 0.0 : 1.0, 1.0}), noise_(1.0) {
  board_quality_.noise_m = static_cast<float>(config.noise_m);
  board_quality_.noise_per_m2 = static_cast<float>(config.noise_per_m2);
  board_quality_.temporal = static_cast<float>(std::sqrt(1.0 - config.static_share));
  board_quality_.fixed = static_cast<float>(std::sqrt(config.static_share));
  board_quality_.least_cosine = static_cast<float>(kLeastCosine);
  board_quality_.highlight_cosine = 2.0F;
  if (scene.specular > kSaturatedHighlight) {
    board_quality_.highlight_cosine =
        static_cast<float>(std::pow(kSaturatedHighlight / scene.specular, 1.0 / kHighlightExponent));
  }
  board_quality_.nearest_m = static_cast<float>(config.nearest_m);
  board_quality_.farthest_m = static_cast<float>(config.farthest_m);
  makeTables(pattern_seed);
}

void DepthRenderer::makeTables(std::uint64_t pattern_seed) {
  const cv::Size size(lens_.width_px, lens_.height_px);
  const bool disparity = errors_.sensor() == DepthSensor::kStructuredLight;
  const double per_step = disparity ? 1.0 / config_.disparity_step_px : 1.0;
  stretch_.create(size, CV_32FC1);
  field_.create(size, CV_32FC1);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const double x = rays_.xRow(v)[u], y = rays_.yRow(v)[u];
      stretch_.at<float>(v, u) = static_cast<float>(std::sqrt(1.0 + x * x + y * y));
      field_.at<float>(v, u) = static_cast<float>(per_step * errors_.field(Eigen::Vector2d(u, v)));
    }
  }
  Random random(pattern_seed, "depth pattern");
  pattern_ = drawPattern(size.width, size.height, random);
  if (disparity) {
    depth_of_.assign(kDisparitySteps, 0);
    for (int step = 1; step < kDisparitySteps; ++step) {
      const double depth_m = errors_.focalBaseline() * per_step / step;
      if (depth_m > 1.2 * config_.farthest_m) continue;
      depth_of_[step] = static_cast<std::uint16_t>(std::min(65535.0, std::round(depth_m / scene_.unit_m)));
    }
  } else {
    // Rays to the image's corners are at most some twice as long as the depth.
    const int steps = static_cast<int>(3.0 * config_.farthest_m / kRangeStepM) + 2;
    for (int step = 0; step < steps; ++step) {
      range_error_.push_back(static_cast<float>(errors_.axial(step * static_cast<double>(kRangeStepM))));
    }
  }
  darkness_.assign(static_cast<std::size_t>(size.width), 0.0F);
  signal_.resize(darkness_.size());
  sigma_.resize(darkness_.size());
  wall_signal_.create(size, CV_32FC1);
  wall_sigma_.create(size, CV_32FC1);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.08, -0.05, 1.0).normalized();
  const PlaneSeen wall = planeSeen(normal, {0.0, 0.0, scene_.wall_distance_m});
  DepthQuality matt = board_quality_;
  matt.highlight_cosine = 2.0F;
  for (int v = 0; v < size.height; ++v) {
    measure(wall, matt, 0, v, size.width, darkness_.data(), wall_signal_.ptr<float>(v),
            wall_sigma_.ptr<float>(v));
  }
}

void DepthRenderer::measure(const PlaneSeen& plane, const DepthQuality& quality, int u, int v, int count,
                            const float* darkness, float* signal, float* sigma) const {
  const DepthRow row{count,
                     rays_.xRow(v) + u,
                     rays_.yRow(v) + u,
                     stretch_.ptr<float>(v) + u,
                     field_.ptr<float>(v) + u,
                     pattern_.ptr<float>(v) + u,
                     darkness};
  if (errors_.sensor() == DepthSensor::kTimeOfFlight) {
    const RangeTable table{range_error_.data(), static_cast<int>(range_error_.size()),
                           static_cast<float>(config_.black_m)};
    measureRange(plane, row, quality, table, signal, sigma);
    return;
  }
  const double per_step = 1.0 / config_.disparity_step_px;
  const DisparityScale scale{static_cast<float>(errors_.focalBaseline() * per_step),
                             static_cast<float>(errors_.disparityScale()),
                             static_cast<float>(errors_.disparityOffsetPx() * per_step)};
  measureDisparity(plane, row, quality, scale, signal, sigma);
}

void DepthRenderer::write(int u, int v, int count, const float* signal, const float* sigma,
                          std::uint16_t* out) const {
  if (errors_.sensor() == DepthSensor::kTimeOfFlight) {
    const auto unit = static_cast<float>(0.001 / scene_.unit_m);
    writeRange(count, signal, sigma, noise_.row(u, v), unit, out);
  } else {
    writeDisparity(count, signal, sigma, noise_.row(u, v), depth_of_.data(), kDisparitySteps, out);
  }
}

int DepthRenderer::shadowPx(const PlaneSeen& plane, int u, int v) const {
  if (errors_.sensor() != DepthSensor::kStructuredLight) return 0;
  const float x = rays_.xRow(v)[u], y = rays_.yRow(v)[u];
  const double nearness = plane.per_x * x + plane.per_y * y + plane.per_one;
  return std::max(0, static_cast<int>(errors_.focalBaseline() * (nearness - 1.0 / scene_.wall_distance_m)));
}

cv::Mat DepthRenderer::render(const Eigen::Isometry3d& iMo, Random& random) {
  noise_.shuffle(random);
  const bool disparity = errors_.sensor() == DepthSensor::kStructuredLight;
  layer_.draw({iMo}, disparity ? kEdgeBlurDisparityPx : kEdgeBlurRangePx);
  const cv::Rect& box = layer_.box();
  const PlaneSeen plane = planeSeen(iMo.linear().col(2), iMo.translation());

  cv::Mat image(lens_.height_px, lens_.width_px, CV_16UC1);
  for (int v = 0; v < lens_.height_px; ++v) {
    auto* out = image.ptr<std::uint16_t>(v);
    write(0, v, lens_.width_px, wall_signal_.ptr<float>(v), wall_sigma_.ptr<float>(v), out);
    if (v < box.y || v >= box.y + box.height || layer_.span(v).empty()) continue;
    const Span span = layer_.span(v);
    const int count = span.end - span.begin, row = v - box.y, shift = span.begin - box.x;
    const float* color = layer_.color().ptr<float>(row) + shift;
    const float* alpha = layer_.alpha().ptr<float>(row) + shift;
    for (int i = 0; i < count; ++i) {
      darkness_[i] = alpha[i] > kAlone ? 1.0F - color[i] / alpha[i] : 0.0F;
    }
    measure(plane, board_quality_, span.begin, v, count, darkness_.data(), signal_.data(), sigma_.data());
    int first_on_board = -1;
    for (int i = 0; i < count; ++i) {
      if (alpha[i] < 1.0F - kAlone) {  // The wall.
        signal_[i] = wall_signal_.at<float>(v, span.begin + i);
        sigma_[i] = wall_sigma_.at<float>(v, span.begin + i);
      } else {
        if (first_on_board < 0) first_on_board = i;
        if (alpha[i] <= kAlone) {
          signal_[i] = kNoSignal;
          sigma_[i] = 0.0F;
        }
      }
    }
    write(span.begin, v, count, signal_.data(), sigma_.data(), out + span.begin);
    if (first_on_board < 0) continue;
    const int edge = span.begin + first_on_board;
    const int shadow = std::min(edge, shadowPx(plane, edge, v));
    std::fill(out + edge - shadow, out + edge, std::uint16_t{0});
  }
  return image;
}

}  // namespace servocal::sim
