// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "lens.h"
#include "sensor_noise.h"

namespace servocal::sim {

/// A link of the arm: everything within `radius_m` of a segment. Camera frame.
struct Capsule {
  Eigen::Vector3d from;
  Eigen::Vector3d to;
  double radius_m;
  double gray;
};

/// The arm behind the board, flat and without shading: clutter that moves with the board. Kept as a copy
/// of the background in which only what the arm covers is redrawn.
class ArmSilhouette {
 public:
  ArmSilhouette(const Lens& lens, const SensorNoise& noise, const cv::Mat& gray32, const cv::Mat& sigma8);

  void draw(const std::vector<Capsule>& links);

  const cv::Mat& gray32() const { return gray32_; }
  const cv::Mat& sigma8() const { return sigma8_; }

 private:
  Lens lens_;
  cv::Mat clean_gray32_;
  cv::Mat clean_sigma8_;
  cv::Mat gray32_;
  cv::Mat sigma8_;
  std::array<std::uint8_t, 256> sigma_of_gray_;
  cv::Rect drawn_;
};

}  // namespace servocal::sim
