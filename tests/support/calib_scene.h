// SPDX-License-Identifier: GPL-3.0-or-later
// Synthetic stops of a robot cell with a known truth: what an ideal detector and an ideal arm would
// report, plus written amounts of Gaussian noise. No images.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "poses.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"

namespace servocal::test {

inline const char* const kCamera = "cam";

/// The default cell's color camera: 1920x1080, f about 1066 px.
inline CameraModel hdCamera() {
  CameraModel camera = CameraModel::fromFieldOfView(1920, 1080, 1.466);
  camera.parameters << 1066.0, 1068.5, 955.0, 545.0, 0.09, -0.12, 0.0006, -0.0004, 0.03;
  return camera;
}

inline CameraModel rationalCamera() {
  CameraModel camera = CameraModel::fromFieldOfView(1920, 1080, 1.466, LensModel::kRational);
  camera.parameters << 1066.0, 1068.5, 955.0, 545.0, 0.4, 0.15, 0.0006, -0.0004, 0.02, 0.33, 0.25, 0.03;
  return camera;
}

struct Noise {
  double corner_px = 0.0;   ///< Per axis, 1 sigma; also the claimed covariance (0.1 px if zero).
  double robot_m = 0.0;     ///< Per axis and stop, 1 sigma, in the flange.
  double robot_rad = 0.0;
};

struct SceneOptions {
  int views = 40;
  double near_m = 0.45;       ///< Distance of the board's centre along the optical axis.
  double far_m = 0.75;
  double max_tilt_rad = 0.7;
  double max_roll_rad = 0.78;
  Mount mount = Mount::kFixed;
  Noise noise;
};

struct Scene {
  BoardSpec board;
  CameraModel camera;
  Mount mount = Mount::kFixed;
  Eigen::Isometry3d camera_pose;  ///< kFixed: bMc. kFlange: eMc.
  Eigen::Isometry3d board_pose;   ///< kFixed: eMo. kFlange: bMo.
  std::vector<Pose<Color, Board>> cMo;  ///< Per view, truth.
  std::vector<Pose<Base, EndEffector>> bMe;  ///< Per view, truth.
  std::vector<Observation> observations;
};

template <class A, class B>
Pose<A, B> disturbed(const Pose<A, B>& pose, std::mt19937_64& random, double sigma_m, double sigma_rad) {
  std::normal_distribution<double> normal;
  const auto draw = [&] { return Eigen::Vector3d(normal(random), normal(random), normal(random)); };
  const Eigen::Vector3d translation = draw() * sigma_m, rotation = draw() * sigma_rad;
  return pose * Pose<B, B>::fromRotationVector(rotation, translation);
}

/// What the camera sees of the board at cMo, with noise; corners outside the image are missing.
inline BoardDetection detect(const BoardSpec& board, const CameraModel& camera, const Pose<Color, Board>& cMo,
                             double sigma_px, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  BoardDetection detection;
  detection.orientation_known = true;
  for (int id = 0; id < board.cornerCount(); ++id) {
    const double du = normal(random) * sigma_px, dv = normal(random) * sigma_px;
    const auto pixel = camera.project(cMo * board.corner(id));
    if (!pixel || !camera.contains(*pixel, 5.0)) continue;
    const double claimed_px = sigma_px > 0 ? sigma_px : 0.1;
    detection.corners.push_back(
        {id, *pixel + Eigen::Vector2d(du, dv), Eigen::Matrix2d::Identity() * claimed_px * claimed_px});
  }
  return detection;
}

/// A board pose whose centre projects into the image, tilted about a random axis in the image plane.
inline Pose<Color, Board> randomView(const CameraModel& camera, const SceneOptions& options,
                                     std::mt19937_64& random) {
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const double u = (0.12 + 0.76 * unit(random)) * camera.width_px;
  const double v = (0.15 + 0.70 * unit(random)) * camera.height_px;
  const double z = options.near_m + (options.far_m - options.near_m) * unit(random);
  const double tilt = options.max_tilt_rad * std::sqrt(unit(random));
  const double direction = 2 * M_PI * unit(random);
  const double roll = options.max_roll_rad * (2 * unit(random) - 1);
  const Eigen::Vector3d centre((u - camera.cx()) / camera.fx() * z, (v - camera.cy()) / camera.fy() * z, z);
  const Eigen::Matrix3d tilted =
      Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(direction), std::sin(direction), 0))
          .toRotationMatrix();
  return Pose<Color, Board>(tilted * Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()).toRotationMatrix(),
                            centre);
}

/// Turns board poses into observations of a robot cell.
inline Scene sceneOf(const std::vector<Pose<Color, Board>>& cMo, const CameraModel& camera,
                     const BoardSpec& board, std::mt19937_64& random, Mount mount = Mount::kFixed,
                     const Noise& noise = {}) {
  Scene scene;
  scene.board = board;
  scene.camera = camera;
  scene.mount = mount;
  // Fixed: the camera 1 m before the base looks back at it. Flange: the camera looks along the tool.
  Eigen::Matrix3d looking_back;
  looking_back << 0, 0, -1, 1, 0, 0, 0, -1, 0;
  const auto spread = randomPose<Color, Color>(random, 0.3, 0.05);
  if (mount == Mount::kFixed) {
    scene.camera_pose = (Pose<Base, Color>(looking_back, {1.3, 0.1, 0.5}) * spread).isometry();
    scene.board_pose = randomPose<EndEffector, Board>(random, 0.5, 0.05).isometry();
  } else {
    scene.camera_pose = (Pose<EndEffector, Color>::fromRotationVector({0, 0, 0.3}, {0.05, 0.03, 0.06}) *
                         spread).isometry();
    scene.board_pose = randomPose<Base, Board>(random, 3.0, 0.6).isometry();
  }
  for (std::size_t i = 0; i < cMo.size(); ++i) {
    const Pose<Base, EndEffector> bMe =
        mount == Mount::kFixed
            ? Pose<Base, EndEffector>(scene.camera_pose * cMo[i].isometry() * scene.board_pose.inverse())
            : Pose<Base, EndEffector>(scene.board_pose * cMo[i].inverse().isometry() *
                                      scene.camera_pose.inverse());
    Observation observation;
    observation.id = static_cast<std::int64_t>(i) + 1;
    observation.stage = "test";
    observation.robot.emplace();
    observation.robot->bMe = disturbed(bMe, random, noise.robot_m, noise.robot_rad);
    StreamObservation seen;
    seen.camera = kCamera;
    seen.width_px = camera.width_px;
    seen.height_px = camera.height_px;
    seen.detection = detect(board, camera, cMo[i], noise.corner_px, random);
    observation.views.push_back(seen);
    scene.cMo.push_back(cMo[i]);
    scene.bMe.push_back(bMe);
    scene.observations.push_back(observation);
  }
  return scene;
}

/// Random views that show the whole board.
inline std::vector<Pose<Color, Board>> randomViews(const CameraModel& camera, const BoardSpec& board,
                                                   const SceneOptions& options, std::mt19937_64& random) {
  std::vector<Pose<Color, Board>> views;
  while (static_cast<int>(views.size()) < options.views) {
    const Pose<Color, Board> cMo = randomView(camera, options, random);
    std::mt19937_64 unused(0);
    if (detect(board, camera, cMo, 0.0, unused).corners.size() == static_cast<std::size_t>(board.cornerCount())) {
      views.push_back(cMo);
    }
  }
  return views;
}

inline Scene makeScene(std::uint64_t seed, const SceneOptions& options = {},
                       const CameraModel& camera = hdCamera(), const BoardSpec& board = {}) {
  std::mt19937_64 random(seed);
  const auto views = randomViews(camera, board, options, random);
  return sceneOf(views, camera, board, random, options.mount, options.noise);
}

/// The seven stops of the bootstrap: a start pose, +40 mm along each base axis, +10 degrees about each
/// flange axis.
inline Scene makeBootstrap(std::uint64_t seed, const Noise& noise, const CameraModel& camera = hdCamera(),
                           const BoardSpec& board = {}) {
  std::mt19937_64 random(seed);
  SceneOptions start;
  start.views = 1;
  const Pose<Color, Board> first = Pose<Color, Board>::fromRotationVector({0.15, -0.1, 0.1}, {0.03, -0.02, 0.6});
  Scene scene = sceneOf({first}, camera, board, random);
  std::vector<Pose<Color, Board>> cMo = {first};
  const Eigen::Isometry3d cMb = scene.camera_pose.inverse();
  for (int axis = 0; axis < 3; ++axis) {
    Eigen::Isometry3d bMe = scene.bMe[0].isometry();
    bMe.translation()[axis] += 0.04;
    cMo.push_back(Pose<Color, Board>(cMb * bMe * scene.board_pose));
  }
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Isometry3d bMe =
        scene.bMe[0].isometry() * Eigen::AngleAxisd(10 * M_PI / 180, Eigen::Vector3d::Unit(axis));
    cMo.push_back(Pose<Color, Board>(cMb * bMe * scene.board_pose));
  }
  std::mt19937_64 again(seed);  // the same cell
  return sceneOf(cMo, camera, board, again, Mount::kFixed, noise);
}

}  // namespace servocal::test
