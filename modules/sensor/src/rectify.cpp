// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor/rectify.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <stdexcept>

namespace servocal::sensor {
namespace {

/// Nodes of the lens table each way. The interpolation error falls with its square: below 0.02 px for the lens
/// of a Kinect's color camera.
constexpr int kLensNodes = 129;
/// Depths farther than this are no measurement of these sensors, m.
constexpr float kFarthest_m = 50.0F;
/// A depth pixel covers at most this many color pixels to either side.
constexpr float kWidestReach_px = 6.0F;
/// More than the distance to the next ray, for what the color lens and the slope of a surface add.
constexpr double kReachFactor = 1.2;

}  // namespace

DepthRectifier::DepthRectifier(const DepthModel& depth, const CameraModel& color, const Pose<Color, Infrared>& cMi,
                               double unit_m)
    : sensor_(depth.sensor), width_(depth.camera.width_px), height_(depth.camera.height_px), color_(color) {
  if (width_ < 2 || height_ < 2 || color.width_px < 1 || color.height_px < 1) {
    throw std::invalid_argument("a camera to register has no pixels");
  }
  if (!cMi.isFinite() || !(unit_m > 0.0)) throw std::invalid_argument("cMi is not finite or the unit not positive");
  const Eigen::Matrix3d cRi = cMi.rotation();
  unit_m_ = static_cast<float>(unit_m);
  if (depth.wiggle.size() > 0) {
    for (const double node : depth.wiggle) wiggle_.push_back(static_cast<float>(node));
    wiggle_.push_back(wiggle_.back());  // so that the last node has a neighbor
    wiggle_from_ = static_cast<float>(depth.wiggle_from_m);
    wiggle_per_m_ = static_cast<float>((depth.wiggle.size() - 1) / (depth.wiggle_to_m - depth.wiggle_from_m));
  }
  for (int i = 0; i < 3; ++i) origin_[i] = static_cast<float>(cMi.translation()[i]);
  rays_.resize(static_cast<std::size_t>(width_) * height_);
  for (int row = 0; row < height_; ++row) {
    for (int column = 0; column < width_; ++column) {
      Ray& ray = rays_[static_cast<std::size_t>(row) * width_ + column];
      const Eigen::Vector2d pixel(column, row);
      const auto along = depth.camera.unproject(pixel);
      if (!along) continue;
      const Eigen::Vector3d direction = cRi * along->homogeneous();
      for (int i = 0; i < 3; ++i) ray.direction[i] = static_cast<float>(direction[i]);
      const double lattice = depth.lattice(pixel);
      if (sensor_ == DepthSensor::kTimeOfFlight) {
        ray.gain = static_cast<float>(depth.slope * unit_m);
        ray.stretch = static_cast<float>(along->homogeneous().norm());
        ray.offset = static_cast<float>((depth.offset + lattice) / along->homogeneous().norm());
      } else {
        ray.gain = static_cast<float>(depth.slope / unit_m);
        ray.offset = static_cast<float>(depth.offset + lattice);
      }
    }
  }

  for (int row = 0; row < height_; ++row) {
    for (int column = 0; column < width_; ++column) {
      Ray& ray = rays_[static_cast<std::size_t>(row) * width_ + column];
      const Ray& right = rays_[static_cast<std::size_t>(row) * width_ + (column + 1 < width_ ? column + 1 : column - 1)];
      const Ray& below = rays_[static_cast<std::size_t>(row + 1 < height_ ? row + 1 : row - 1) * width_ + column];
      const double to_right = std::hypot(right.direction[0] - ray.direction[0], right.direction[1] - ray.direction[1]);
      const double to_below = std::hypot(below.direction[0] - ray.direction[0], below.direction[1] - ray.direction[1]);
      ray.half_px = static_cast<float>(
          std::max(0.5 * kReachFactor * std::max(to_right * color.fx(), to_below * color.fy()), 0.5));
    }
  }

  // The lens table spans the normalized coordinates that the image sees, and a little more.
  double least_x = 0.0, most_x = 0.0, least_y = 0.0, most_y = 0.0;
  for (int k = 0; k <= 16; ++k) {
    const double u = -8.0 + (color.width_px + 16.0) * k / 16.0, v = -8.0 + (color.height_px + 16.0) * k / 16.0;
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(u, -8.0), Eigen::Vector2d(u, color.height_px + 8.0),
                                         Eigen::Vector2d(-8.0, v), Eigen::Vector2d(color.width_px + 8.0, v)}) {
      const auto along = color.unproject(pixel);
      if (!along) continue;
      least_x = std::min(least_x, along->x()), most_x = std::max(most_x, along->x());
      least_y = std::min(least_y, along->y()), most_y = std::max(most_y, along->y());
    }
  }
  if (!(most_x > least_x) || !(most_y > least_y)) throw std::invalid_argument("the color camera sees nothing");
  lens_.columns = lens_.rows = kLensNodes;
  lens_.min_x = static_cast<float>(least_x), lens_.min_y = static_cast<float>(least_y);
  lens_.per_x = static_cast<float>((kLensNodes - 1) / (most_x - least_x));
  lens_.per_y = static_cast<float>((kLensNodes - 1) / (most_y - least_y));
  lens_.pixels.reserve(2U * kLensNodes * kLensNodes);
  for (int row = 0; row < kLensNodes; ++row) {
    for (int column = 0; column < kLensNodes; ++column) {
      const double x = least_x + (most_x - least_x) * column / (kLensNodes - 1);
      const double y = least_y + (most_y - least_y) * row / (kLensNodes - 1);
      const auto pixel = color.project(Eigen::Vector3d(x, y, 1.0));
      lens_.pixels.push_back(pixel ? static_cast<float>(pixel->x()) : std::numeric_limits<float>::quiet_NaN());
      lens_.pixels.push_back(pixel ? static_cast<float>(pixel->y()) : std::numeric_limits<float>::quiet_NaN());
    }
  }
}

void DepthRectifier::check(const cv::Mat& raw) const {
  if (raw.type() != CV_16UC1 || raw.cols != width_ || raw.rows != height_) {
    throw std::invalid_argument("a raw depth image must be CV_16UC1 of the infrared camera's size");
  }
}

float DepthRectifier::wiggling(float range) const {
  const float at = std::clamp((range - wiggle_from_) * wiggle_per_m_, 0.0F, static_cast<float>(wiggle_.size() - 2));
  const auto node = static_cast<std::size_t>(at);
  const float beyond = at - static_cast<float>(node);
  return (1 - beyond) * wiggle_[node] + beyond * wiggle_[node + 1];
}

float DepthRectifier::correct(const Ray& ray, std::uint16_t count) const {
  if (count == 0 || ray.gain == 0.0F) return 0.0F;
  const auto raw = static_cast<float>(count);
  float depth = sensor_ == DepthSensor::kTimeOfFlight ? ray.offset + ray.gain * raw : 1.0F / (ray.offset + ray.gain / raw);
  if (!wiggle_.empty()) depth += wiggling(raw * unit_m_ * ray.stretch) / ray.stretch;
  return depth > 0.0F && depth < kFarthest_m ? depth : 0.0F;
}

cv::Mat DepthRectifier::corrected(const cv::Mat& raw) const {
  check(raw);
  cv::Mat out(height_, width_, CV_32FC1);
  const Ray* ray = rays_.data();
  for (int row = 0; row < height_; ++row) {
    const auto* counts = raw.ptr<std::uint16_t>(row);
    auto* depths = out.ptr<float>(row);
    for (int column = 0; column < width_; ++column) depths[column] = correct(*ray++, counts[column]);
  }
  return out;
}

cv::Mat DepthRectifier::registered(const cv::Mat& raw) const {
  check(raw);
  cv::Mat out = cv::Mat::zeros(color_.height_px, color_.width_px, CV_32FC1);
  const Ray* ray = rays_.data();
  for (int row = 0; row < height_; ++row) {
    const auto* counts = raw.ptr<std::uint16_t>(row);
    for (int column = 0; column < width_; ++column, ++ray) {
      const float depth = correct(*ray, counts[column]);
      if (!(depth > 0.0F)) continue;
      const float z = depth * ray->direction[2] + origin_[2];
      if (!(z > 0.0F)) continue;
      const float x = ((depth * ray->direction[0] + origin_[0]) / z - lens_.min_x) * lens_.per_x;
      const float y = ((depth * ray->direction[1] + origin_[1]) / z - lens_.min_y) * lens_.per_y;
      if (!(x >= 0.0F && y >= 0.0F && x < static_cast<float>(lens_.columns - 1) &&
            y < static_cast<float>(lens_.rows - 1))) {
        continue;
      }
      const int i = static_cast<int>(x), j = static_cast<int>(y);
      const float fx = x - static_cast<float>(i), fy = y - static_cast<float>(j);
      const float* upper = &lens_.pixels[2 * (static_cast<std::size_t>(j) * lens_.columns + i)];
      const float* lower = upper + 2 * lens_.columns;
      const float u = (1 - fy) * ((1 - fx) * upper[0] + fx * upper[2]) + fy * ((1 - fx) * lower[0] + fx * lower[2]);
      const float v = (1 - fy) * ((1 - fx) * upper[1] + fx * upper[3]) + fy * ((1 - fx) * lower[1] + fx * lower[3]);
      // A point farther from one camera than from the other is seen larger there.
      const float reach = std::min(ray->half_px * depth / z, kWidestReach_px);
      if (!(u > -reach && v > -reach)) continue;  // not-a-number too
      const int left = std::max(static_cast<int>(std::ceil(u - reach)), 0);
      const int right = std::min(static_cast<int>(std::floor(u + reach)), color_.width_px - 1);
      const int top = std::max(static_cast<int>(std::ceil(v - reach)), 0);
      const int bottom = std::min(static_cast<int>(std::floor(v + reach)), color_.height_px - 1);
      for (int to_row = top; to_row <= bottom; ++to_row) {
        auto* to = out.ptr<float>(to_row);
        for (int at = left; at <= right; ++at) {
          if (to[at] == 0.0F || z < to[at]) to[at] = z;
        }
      }
    }
  }
  return out;
}

cv::Mat DepthRectifier::registeredMm(const cv::Mat& raw) const {
  cv::Mat out;
  registered(raw).convertTo(out, CV_16UC1, 1000.0);
  return out;
}

}  // namespace servocal::sensor
