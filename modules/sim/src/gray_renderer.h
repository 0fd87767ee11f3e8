// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>

#include "arm_silhouette.h"
#include "board_layer.h"
#include "lens.h"
#include "sensor_noise.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/simulation.h"

namespace servocal::sim {

/// Turns board poses into gray images of one color or infrared camera. Expensive tables are made at
/// construction.
class GrayRenderer {
 public:
  GrayRenderer(const BoardSpec& board, const Lens& lens, const Light& light, const Tones& tones,
               const SimulatedSensorConfig& sensor, const cv::Mat& background);
  GrayRenderer(const GrayRenderer&) = delete;  // The board's layer refers to the ray table.
  GrayRenderer& operator=(const GrayRenderer&) = delete;

  /// cMo at a fraction of the exposure, 0 its begin and 1 its end.
  using BoardMotion = std::function<Eigen::Isometry3d(double)>;

  /// One exposure, CV_8UC1: the arm's links behind the board. `random` gives the frame's noise.
  cv::Mat render(const BoardMotion& cMo, const std::vector<Capsule>& links, Random& random);

 private:
  std::vector<Eigen::Isometry3d> subExposures(const BoardMotion& cMo) const;

  BoardSpec board_;
  Lens lens_;
  SimulatedSensorConfig sensor_;
  RayTable rays_;
  BoardLayer layer_;
  SensorNoise noise_;
  std::unique_ptr<ArmSilhouette> backdrop_;
};

}  // namespace servocal::sim
