// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "board_layer.h"
#include "depth_errors.h"
#include "depth_kernels.h"
#include "sensor_noise.h"
#include "servocal/core/cell_config.h"

namespace servocal::sim {

/// Turns board poses into depth images of one camera: the board's plate in front of a wall. Depth is that of
/// the middle of the exposure; the arm is left out. Expensive tables are made at construction.
class DepthRenderer {
 public:
  struct Scene {
    double wall_distance_m = 2.5;
    double specular = 0.0;    ///< Of the board's surface.
    bool black_shows = true;  ///< False: the print's black reflects infrared as its white does.
    double unit_m = 0.001;    ///< Of the values handed out.
  };

  DepthRenderer(const BoardSpec& board, const Lens& lens, const SimulatedDepthConfig& config,
                const DepthErrors& errors, const Scene& scene, std::uint64_t pattern_seed);
  DepthRenderer(const DepthRenderer&) = delete;  // The board's layer refers to the ray table.
  DepthRenderer& operator=(const DepthRenderer&) = delete;

  /// CV_16UC1; 0 where nothing is measured. `random` gives the frame's noise.
  cv::Mat render(const Eigen::Isometry3d& iMo, Random& random);

 private:
  void makeTables(std::uint64_t pattern_seed);
  void measure(const PlaneSeen& plane, const DepthQuality& quality, int u, int v, int count,
               const float* darkness, float* signal, float* sigma) const;
  void write(int u, int v, int count, const float* signal, const float* sigma, std::uint16_t* out) const;
  /// Columns to the left of the board's edge at a pixel that the projector cannot reach.
  int shadowPx(const PlaneSeen& plane, int u, int v) const;

  Lens lens_;
  SimulatedDepthConfig config_;
  DepthErrors errors_;
  Scene scene_;
  RayTable rays_;
  BoardLayer layer_;
  SensorNoise noise_;
  DepthQuality board_quality_;
  std::vector<float> range_error_;       ///< Time of flight.
  std::vector<std::uint16_t> depth_of_;  ///< Structured light: by steps of disparity.
  cv::Mat stretch_, field_, pattern_;    ///< CV_32FC1, like the two below.
  cv::Mat wall_signal_, wall_sigma_;
  std::vector<float> darkness_, signal_, sigma_;  ///< Of one row.
};

}  // namespace servocal::sim
