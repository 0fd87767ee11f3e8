// SPDX-License-Identifier: GPL-3.0-or-later
// Synthetic depth of a board with a known distortion: raw depth that a known model corrects exactly.
#pragma once

#include <functional>

#include "calib_scene.h"
#include "servocal/core/depth_model.h"

namespace servocal::test {

/// The infrared camera of a Kinect v2: 512 x 424, f about 366 px.
inline CameraModel depthCamera() {
  CameraModel camera = CameraModel::fromFieldOfView(512, 424, 1.22);
  camera.parameters << 366.2, 365.8, 257.0, 208.5, 0.09, -0.27, 0.0004, -0.0003, 0.09;
  return camera;
}

/// Smooth lattice of mean zero over the image with about `size` from crest to trough.
inline Eigen::VectorXd wavyNodes(int nodes_x, int nodes_y, double size) {
  Eigen::VectorXd nodes(nodes_x * nodes_y);
  double sum = 0.0, weights = 0.0;
  for (int row = 0; row < nodes_y; ++row) {
    for (int column = 0; column < nodes_x; ++column) {
      const double x = column / (nodes_x - 1.0), y = row / (nodes_y - 1.0);
      nodes[row * nodes_x + column] = 0.5 * size * (std::sin(4.0 * x + 1.0) * std::cos(3.0 * y) + x * y);
      const double weight = (column % (nodes_x - 1) ? 1.0 : 0.5) * (row % (nodes_y - 1) ? 1.0 : 0.5);
      sum += weight * nodes[row * nodes_x + column];
      weights += weight;
    }
  }
  nodes.array() -= sum / weights;
  return nodes;
}

/// Time of flight: 24 mm offset, 0.4 % of the range, 8 mm over the image.
inline DepthModel timeOfFlight() {
  DepthModel model;
  model.sensor = DepthSensor::kTimeOfFlight;
  model.camera = depthCamera();
  model.offset = -0.024;
  model.slope = 1.004;
  model.nodes_x = 8;
  model.nodes_y = 6;
  model.nodes = wavyNodes(8, 6, 0.008);
  return model;
}

/// The same with a wiggling error of two harmonics, 2 mm from crest to trough.
inline DepthModel wigglingTimeOfFlight() {
  DepthModel model = timeOfFlight();
  model.wiggle_from_m = 0.3;
  model.wiggle_to_m = 2.3;
  model.wiggle.resize(201);
  for (Eigen::Index k = 0; k < model.wiggle.size(); ++k) {
    const double range_m = 0.3 + 0.01 * static_cast<double>(k);
    model.wiggle[k] = 6e-4 * std::sin(2 * M_PI * range_m / 0.47 + 1.0) + 6e-4 * std::sin(2 * M_PI * range_m / 1.25);
  }
  return model;
}

/// Structured light: at 0.8 m about 10 mm offset, 0.8 % of the inverse depth, 8 mm over the image.
inline DepthModel structuredLight() {
  DepthModel model = timeOfFlight();
  model.sensor = DepthSensor::kStructuredLight;
  model.camera = CameraModel::fromFieldOfView(640, 480, 1.01);
  model.camera.parameters << 580.5, 579.6, 321.0, 243.0, -0.08, 0.2, 0.0003, -0.0004, -0.1;
  model.offset = 0.015;
  model.slope = 0.992;
  model.nodes = wavyNodes(8, 6, 0.0125);
  return model;
}

/// The raw depth that `model` corrects to `depth_m`.
inline double distorted(const DepthModel& model, const Eigen::Vector2d& pixel, double depth_m) {
  if (model.sensor == DepthSensor::kStructuredLight) {
    return model.slope / (1.0 / depth_m - model.offset - model.lattice(pixel));
  }
  const double stretch = std::sqrt(1.0 + model.camera.unproject(pixel)->squaredNorm());
  const double range_m = depth_m * stretch - model.offset - model.lattice(pixel);
  double raw_m = range_m / model.slope;
  for (int i = 0; i < 30; ++i) raw_m = (range_m - model.wiggling(raw_m)) / model.slope;
  return raw_m / stretch;
}

struct DepthNoise {
  double corner_px = 0.0;
  double patch_m = 0.0;    ///< Per patch; also the claimed sigma (0.1 mm if zero).
  double common_m = 0.0;   ///< Per view.
};

/// Depth of the board's plane along the ray of a pixel.
inline double planeDepth(const Pose<Color, Board>& cMo, const CameraModel& camera, const Eigen::Vector2d& pixel) {
  const Eigen::Vector3d ray = camera.unproject(pixel)->homogeneous();
  const Eigen::Vector3d normal = cMo.rotation().col(2);
  return normal.dot(cMo.translation()) / normal.dot(ray);
}

/// Patches as an ideal reduction of the depth image would give them, 5 x 4 over the board.
inline BoardDepth patchesOf(const DepthModel& truth, const BoardSpec& board, const Pose<Color, Board>& cMo,
                            const DepthNoise& noise, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  BoardDepth depth;
  const double common = normal(random) * noise.common_m;
  const auto outline = board.patternOutline();
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 5; ++column) {
      const Eigen::Vector3d place = outline[0] + (outline[1] - outline[0]) * ((column + 0.5) / 5.0) +
                                    (outline[3] - outline[0]) * ((row + 0.5) / 4.0);
      const double draw = normal(random) * noise.patch_m;
      const auto pixel = truth.camera.project(cMo * place);
      if (!pixel || !truth.camera.contains(*pixel)) continue;
      const double raw = distorted(truth, *pixel, (cMo * place).z());
      depth.patches.push_back({*pixel, raw + common + draw, noise.patch_m > 0.0 ? noise.patch_m : 1e-4, 400});
    }
  }
  depth.frames = 5;
  return depth;
}

struct DepthScene {
  BoardSpec board;
  DepthModel truth;
  Scene cell;                             ///< Robot and infrared camera; observations without depth.
  std::vector<Observation> observations;  ///< Infrared views with depth.
};

inline DepthScene makeDepthScene(std::uint64_t seed, const DepthModel& truth, const SceneOptions& options,
                                 const DepthNoise& noise = {}) {
  std::mt19937_64 random(seed);
  DepthScene scene;
  scene.truth = truth;
  const auto cMo = randomViews(truth.camera, scene.board, options, random);
  Noise cell_noise = options.noise;
  cell_noise.corner_px = noise.corner_px;
  scene.cell = sceneOf(cMo, truth.camera, scene.board, random, options.mount, cell_noise);
  scene.observations = scene.cell.observations;
  for (std::size_t i = 0; i < cMo.size(); ++i) {
    StreamObservation& seen = scene.observations[i].views[0];
    seen.stream = Stream::kInfrared;
    seen.depth = patchesOf(truth, scene.board, cMo[i], noise, random);
  }
  return scene;
}

/// Error of a correction (m, RMS) over a grid of pixels and depths, 8 % of the image kept from its border.
inline double correctionError(const DepthModel& model, const DepthModel& truth, double near_m, double far_m) {
  double squares = 0.0;
  int count = 0;
  for (int row = 0; row < 7; ++row) {
    for (int column = 0; column < 9; ++column) {
      const Eigen::Vector2d pixel((0.08 + 0.84 * column / 8.0) * (truth.camera.width_px - 1),
                                  (0.08 + 0.84 * row / 6.0) * (truth.camera.height_px - 1));
      for (int k = 0; k < 5; ++k) {
        const double depth = near_m + (far_m - near_m) * k / 4.0;
        const auto corrected = model.correct(pixel, distorted(truth, pixel, depth));
        squares += corrected ? std::pow(*corrected - depth, 2) : 1.0;
        ++count;
      }
    }
  }
  return std::sqrt(squares / count);
}

}  // namespace servocal::test
