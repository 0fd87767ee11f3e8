// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "servocal/core/camera_model.h"
#include "servocal/core/depth_model.h"
#include "servocal/core/pose.h"

namespace servocal::sensor {

/// Corrects depth images of one camera and registers them to its color image. Everything that depends on the
/// pixel alone is computed once; an image then costs a few operations per pixel.
///
/// Output: for every color pixel the depth along the color camera's optical axis, 0 where there is none. Each
/// depth pixel covers the color pixels it spans, so that a color image of higher resolution has no holes; where
/// several meet, the nearest one counts (z-buffer).
class DepthRectifier {
 public:
  /// `depth.camera` is the infrared camera, whose pixels the depth images share; `cMi` its pose in the color
  /// camera; `unit_m` the length of one count of the raw images.
  /// @throws std::invalid_argument if a camera has no pixels, cMi is not finite or unit_m not positive.
  DepthRectifier(const DepthModel& depth, const CameraModel& color, const Pose<Color, Infrared>& cMi,
                 double unit_m = 0.001);

  /// The corrected depth along the infrared camera's axis, in its own pixels; CV_32FC1, m, 0: none.
  /// @throws std::invalid_argument unless `raw` is CV_16UC1 of the infrared camera's size.
  cv::Mat corrected(const cv::Mat& raw) const;
  /// Corrected and registered to color; CV_32FC1, m.
  /// @throws std::invalid_argument as corrected().
  cv::Mat registered(const cv::Mat& raw) const;
  /// The same, CV_16UC1 in mm.
  cv::Mat registeredMm(const cv::Mat& raw) const;

 private:
  /// Along the ray of an infrared pixel, a point of depth z is at z * direction + origin in the color camera.
  struct Ray {
    float direction[3];
    float gain = 0.0F;     ///< Corrected = offset + gain * raw (range), or 1 / (offset + gain / raw); 0: no ray.
    float offset = 0.0F;
    float stretch = 1.0F;    ///< Range over depth.
    float half_px = 0.5F;  ///< Half the distance to its neighbors, in color pixels, seen from equally far.
  };

  float correct(const Ray& ray, std::uint16_t count) const;
  float wiggling(float range) const;
  void check(const cv::Mat& raw) const;

  DepthSensor sensor_;
  int width_ = 0, height_ = 0;
  CameraModel color_;
  float origin_[3];
  std::vector<Ray> rays_;
  std::vector<float> wiggle_;  ///< DepthModel::wiggle, one more of the last at its end; empty: none.
  float wiggle_from_ = 0.0F, wiggle_per_m_ = 0.0F, unit_m_ = 0.0F;
  /// Lens of the color camera as a table: its pixel by normalized coordinates on a grid, bilinear.
  struct LensTable {
    float min_x = 0, min_y = 0, per_x = 0, per_y = 0;
    int columns = 0, rows = 0;
    std::vector<float> pixels;  ///< u, v by node, not-a-number where nothing projects.
  } lens_;
};

}  // namespace servocal::sensor
