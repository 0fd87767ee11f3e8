// SPDX-License-Identifier: GPL-3.0-or-later
// A cell of several cameras with a known truth, and what an ideal detector and an ideal arm would report at
// its stops, plus written amounts of Gaussian noise. No images.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "calib_scene.h"
#include "servocal/calib/joint.h"

namespace servocal::test {

struct CellCamera {
  std::string name;
  Stream stream = Stream::kColor;
  CameraModel model;
  Eigen::Isometry3d pose;  ///< kFixed: bMc. kFlange: eMc.
};

/// The truth.
struct Cell {
  BoardSpec board;
  Mount mount = Mount::kFixed;
  std::vector<CellCamera> cameras;
  Eigen::Isometry3d board_pose;  ///< kFixed: eMo. kFlange: bMo.
  calib::BoardShape shape;
};

/// A stop as it is, and as the robot's controller believes it to be.
struct CellStop {
  Pose<Base, EndEffector> bMe;
  Eigen::VectorXd q;
};

/// Kinect v2 like infrared camera: 512 x 424, f about 366 px.
inline CameraModel infraredCamera() {
  CameraModel camera = CameraModel::fromFieldOfView(512, 424, 1.22);
  camera.parameters << 366.0, 366.8, 257.0, 210.0, 0.09, -0.26, 0.0004, -0.0003, 0.09;
  return camera;
}

/// Kinect v1 like color camera: 640 x 480, f about 525 px.
inline CameraModel vgaCamera() {
  CameraModel camera = CameraModel::fromFieldOfView(640, 480, 1.09);
  camera.parameters << 525.0, 526.1, 318.0, 243.0, 0.2, -0.45, 0.0005, -0.0006, 0.3;
  return camera;
}

/// A camera of the cell that looks from `from_m` to `to_m` (base), with the image's x level.
inline Eigen::Isometry3d lookingAt(const Eigen::Vector3d& from_m, const Eigen::Vector3d& to_m) {
  const Eigen::Vector3d z = (to_m - from_m).normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() << x, z.cross(x), z;
  pose.translation() = from_m;
  return pose;
}

/// `kinects` RGB-D cameras: v2 at +-45 degrees, a v1 color camera (with an infrared one like the v2's)
/// between. On the flange: side by side along the tool, looking ahead.
inline Cell makeCell(std::uint64_t seed, int kinects = 1, Mount mount = Mount::kFixed, bool infrared = true) {
  std::mt19937_64 random(seed);
  Cell cell;
  cell.mount = mount;
  const Eigen::Vector3d middle_m(0.55, 0.0, 0.45);
  for (int k = 0; k < kinects; ++k) {
    const double angle = (k == 0 ? -1 : k == 1 ? 1 : 0) * M_PI / 4;
    const Eigen::Vector3d from_m = middle_m + 0.75 * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0.15);
    const auto spread = randomPose<Color, Color>(random, 0.1, 0.03);
    Eigen::Isometry3d pose = lookingAt(from_m, middle_m) * spread.isometry();
    if (mount == Mount::kFlange) {
      pose = Pose<EndEffector, Color>::fromRotationVector({0, 0, 0.3}, {0.05 - 0.12 * k, 0.03, 0.06})
                 .isometry() *
             spread.isometry();
    }
    const std::string name = "k" + std::to_string(k + 1);
    cell.cameras.push_back({name, Stream::kColor, k == 2 ? vgaCamera() : hdCamera(), pose});
    const auto beside =
        Pose<Color, Infrared>::fromRotationVector({0.004, -0.006, 0.003}, {-0.052, 0.001, 0.002});
    if (infrared) {
      cell.cameras.push_back({name, Stream::kInfrared, infraredCamera(), pose * beside.isometry()});
    }
  }
  cell.board_pose = mount == Mount::kFixed ? randomPose<EndEffector, Board>(random, 0.5, 0.05).isometry()
                                           : randomPose<Base, Board>(random, 3.0, 0.6).isometry();
  return cell;
}

inline Eigen::Isometry3d trueBoardInCamera(const Cell& cell, const CellCamera& camera,
                                           const Pose<Base, EndEffector>& bMe) {
  const Eigen::Isometry3d lMr = cell.mount == Mount::kFixed ? bMe.isometry() : bMe.inverse().isometry();
  return camera.pose.inverse() * lMr * cell.board_pose;
}

/// Stops at random views of one camera after the other, all of the board in that camera's image.
inline std::vector<CellStop> randomStops(const Cell& cell, int count, std::mt19937_64& random,
                                         SceneOptions options = {}) {
  std::vector<CellStop> stops;
  options.views = 1;
  for (int i = 0; i < count; ++i) {
    const CellCamera& camera = cell.cameras[static_cast<std::size_t>(i) % cell.cameras.size()];
    const Eigen::Isometry3d cMo = randomViews(camera.model, cell.board, options, random).front().isometry();
    const Eigen::Isometry3d lMr = camera.pose * cMo * cell.board_pose.inverse();
    stops.push_back({Pose<Base, EndEffector>(cell.mount == Mount::kFixed ? lMr : lMr.inverse()), {}});
  }
  return stops;
}

inline Eigen::Vector3d shapedCorner(const Cell& cell, int id) {
  Eigen::Vector2d half = Eigen::Vector2d::Constant(1e-9);
  for (const Eigen::Vector3d& corner : cell.board.corners())
    half = half.cwiseMax(corner.head<2>().cwiseAbs());
  const Eigen::Vector3d corner = cell.board.corner(id);
  const Eigen::Vector2d share = corner.head<2>().cwiseQuotient(half);
  return {
      cell.shape.scale_x * corner.x(), cell.shape.scale_y * corner.y(),
      cell.shape.bow_x_m * (1 - share.x() * share.x()) + cell.shape.bow_y_m * (1 - share.y() * share.y())};
}

/// What is observed at a stop: the robot says where it is but for its noise; a camera that sees less than the
/// whole board sees nothing.
inline Observation observe(const Cell& cell, const CellStop& stop, std::int64_t id, const Noise& noise,
                           std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const auto draw = [&] { return Eigen::Vector3d(normal(random), normal(random), normal(random)); };
  Observation observation;
  observation.id = id;
  observation.stage = "test";
  observation.robot.emplace();
  observation.robot->q = stop.q;
  const Eigen::Vector3d shift = draw() * noise.robot_m, turn = draw() * noise.robot_rad;
  observation.robot->bMe =
      stop.bMe * Pose<EndEffector, EndEffector>::fromRotationVector(turn, shift).inverse();
  for (const CellCamera& camera : cell.cameras) {
    const Eigen::Isometry3d cMo = trueBoardInCamera(cell, camera, stop.bMe);
    StreamObservation seen;
    seen.camera = camera.name;
    seen.stream = camera.stream;
    seen.width_px = camera.model.width_px;
    seen.height_px = camera.model.height_px;
    seen.detection.orientation_known = true;
    const double claimed_px = noise.corner_px > 0 ? noise.corner_px : 0.1;
    bool whole = true,
         facing = -(cMo.linear().col(2).dot(cMo.translation())) < -0.2 * cMo.translation().norm();
    for (int corner = 0; corner < cell.board.cornerCount(); ++corner) {
      const double du = normal(random) * noise.corner_px, dv = normal(random) * noise.corner_px;
      const auto pixel = camera.model.project(cMo * shapedCorner(cell, corner));
      whole = whole && pixel && camera.model.contains(*pixel, 5.0);
      if (!whole) continue;
      seen.detection.corners.push_back(
          {corner, *pixel + Eigen::Vector2d(du, dv), Eigen::Matrix2d::Identity() * claimed_px * claimed_px});
    }
    if (whole && facing) observation.views.push_back(seen);
  }
  return observation;
}

inline std::vector<Observation> observeAll(const Cell& cell, const std::vector<CellStop>& stops,
                                           const Noise& noise, std::mt19937_64& random) {
  std::vector<Observation> observations;
  for (const CellStop& stop : stops) {
    observations.push_back(
        observe(cell, stop, static_cast<std::int64_t>(observations.size()) + 1, noise, random));
  }
  return observations;
}

/// Estimate minus truth of every shared parameter, in the order of JointSolution::names; robot terms: the
/// estimate.
inline Eigen::VectorXd errorsOf(const calib::JointSolution& solution, const Cell& cell) {
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(solution.names.size()));
  const auto pose = [](const Eigen::Isometry3d& estimate, const Eigen::Isometry3d& truth) {
    Eigen::Matrix<double, 6, 1> error;
    error << estimate.translation() - truth.translation(),
        Pose<Base, Base>(Eigen::Matrix3d(estimate.linear() * truth.linear().transpose()), {0, 0, 0})
            .rotationVector();
    return error;
  };
  for (const calib::JointCamera& camera : solution.cameras) {
    for (const CellCamera& truth : cell.cameras) {
      if (truth.name != camera.camera || truth.stream != camera.stream) continue;
      for (std::size_t p = 0; p < camera.free.size(); ++p) {
        errors[camera.intrinsics_at + static_cast<int>(p)] =
            camera.model.parameters[camera.free[p]] - truth.model.parameters[camera.free[p]];
      }
      errors.segment<6>(camera.pose_at) = pose(camera.pose, truth.pose);
    }
  }
  errors.segment<6>(solution.board_at) = pose(solution.board_pose, cell.board_pose);
  int at = solution.shape_at;
  if (solution.board_freedom.scale) {
    errors[at++] = solution.board.scale_x - cell.shape.scale_x;
    errors[at++] = solution.board.scale_y - cell.shape.scale_y;
  }
  if (solution.board_freedom.bow) {
    errors[at++] = solution.board.bow_x_m - cell.shape.bow_x_m;
    errors[at++] = solution.board.bow_y_m - cell.shape.bow_y_m;
  }
  errors.tail(solution.robot_terms.size()) = solution.robot_terms;
  return errors;
}

/// The truth in the form of a solution (its lists of parameters are those of `form`).
inline calib::JointSolution truthLike(const calib::JointSolution& form, const Cell& cell,
                                      const Noise& noise) {
  calib::JointSolution truth = form;
  for (calib::JointCamera& camera : truth.cameras) {
    for (const CellCamera& known : cell.cameras) {
      if (known.name != camera.camera || known.stream != camera.stream) continue;
      camera.model = known.model;
      camera.pose = known.pose;
    }
    camera.corner_scale = noise.corner_px / std::hypot(noise.corner_px, 0.03);  // claims have a floor added
  }
  truth.board_pose = cell.board_pose;
  truth.board = cell.shape;
  truth.robot_terms.setZero();
  truth.robot.sigma_m = noise.robot_m;
  truth.robot.sigma_rad = noise.robot_rad;
  return truth;
}

}  // namespace servocal::test
