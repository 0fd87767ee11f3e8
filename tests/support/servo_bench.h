// SPDX-License-Identifier: GPL-3.0-or-later
// A fake arm with a target, a fake camera before it, and the guard between them.
#pragma once

#include <memory>
#include <optional>
#include <random>
#include <stdexcept>
#include <vector>

#include "fake_arm.h"
#include "fake_observer.h"
#include "poses.h"
#include "servocal/robot/guard.h"

namespace servocal::test {

inline constexpr double kDegree = 0.017453292519943295;

inline MotionLimits cellLimits() {
  MotionLimits limits;
  limits.workspace = {"workspace", {-1.0, -1.0, 0.0}, {1.0, 1.0, 1.2}};
  return limits;
}

struct BenchOptions {
  FakeArmOptions arm;
  FakeObserverOptions observer;
  robot::GuardOptions guard;
  MotionLimits limits = cellLimits();
  double focal_error = 0.0;  ///< Relative, of the camera model the loop believes in.
  bool ignore_distortion = false;
};

/// Truth: a UR5 whose target faces a camera 0.6 m away. What a test lets the loop believe is its business.
struct Bench {
  explicit Bench(const BenchOptions& options = {})
      : kinematics(ArmConfig{}), points_o(board.corners()), camera(trueCamera()), believed(camera),
        bMc(Eigen::Matrix3d((Eigen::Matrix3d() << 1, 0, 0, 0, 0, 1, 0, -1, 0).finished()),
            Eigen::Vector3d(-0.1, -1.1, 0.4)),
        eMo(Pose<EndEffector, Board>::fromRotationVector({3.0, 0.1, -0.15}, {0.02, -0.03, 0.04})),
        start_q(jointsFor(view({0, 0, 0.6}, {0, 0, 0}))),
        arm(kinematics, clock, start_q, options.arm),
        observer(arm, clock, points_o, camera, believe(options), bMc, eMo, options.observer) {
    guard = std::make_unique<robot::Guard>(arm, kinematics, clock, options.limits, board, options.guard);
    guard->setBoard(eMo);
  }

  static CameraModel trueCamera() {
    CameraModel camera = CameraModel::fromFieldOfView(1920, 1080, 1.466);
    camera.parameters << 1066, 1064, 965, 532, 0.09, -0.12, 0.0006, -0.0004, 0.03;
    return camera;
  }
  const CameraModel& believe(const BenchOptions& options) {
    believed.parameters[0] *= 1.0 + options.focal_error;
    believed.parameters[1] *= 1.0 + options.focal_error;
    if (options.ignore_distortion) believed.parameters.tail(5).setZero();
    return believed;
  }

  /// Target pose in the camera: position (m) and rotation vector against facing it.
  static Pose<Color, Board> view(const Eigen::Vector3d& position, const Eigen::Vector3d& rotation) {
    return Pose<Color, Board>::fromRotationVector(rotation, position);
  }
  Pose<Base, EndEffector> flangeFor(const Pose<Color, Board>& cMo) const { return bMc * cMo * eMo.inverse(); }
  Eigen::VectorXd jointsFor(const Pose<Color, Board>& cMo) const {
    const Eigen::VectorXd seed = (Eigen::VectorXd(6) << -1.2, -1.9, -1.9, 0.6, 1.5, 0.0).finished();
    const auto q = kinematics.inverse(flangeFor(cMo), seed);
    if (!q) throw std::runtime_error("bench: the arm does not reach the view");
    return *q;
  }
  servo::CellEstimate truth(bool with_camera_pose) const {
    servo::CellEstimate cell;
    cell.camera = believed;
    cell.eMo = eMo;
    if (with_camera_pose) cell.bMc = bMc;
    return cell;
  }
  /// The true target pose in the camera now.
  Pose<Color, Board> cMo() { return bMc.inverse() * arm.state().bMe * eMo; }
  /// Smallest distance of a target point from the image border at a flange pose, px; -1e9 if behind.
  double borderPx(const Pose<Base, EndEffector>& bMe) const {
    double least = 1e9;
    for (const Eigen::Vector3d& point_o : points_o) {
      const auto pixel = camera.project(bMc.inverse() * bMe * eMo * point_o);
      if (!pixel) return -1e9;
      least = std::min({least, pixel->x(), pixel->y(), camera.width_px - 1 - pixel->x(),
                        camera.height_px - 1 - pixel->y()});
    }
    return least;
  }
  /// A view at random that is well inside the image and that the arm reaches.
  Pose<Color, Board> randomView(std::mt19937_64& random, double max_tilt_rad = 30 * kDegree,
                                double margin_px = 40.0) const {
    std::uniform_real_distribution<double> unit(-1.0, 1.0);
    for (int attempt = 0; attempt < 1000; ++attempt) {
      const double z = 0.6 + 0.12 * unit(random);
      const Eigen::Vector3d position(0.6 * z * unit(random), 0.35 * z * unit(random), z);
      const Eigen::Vector3d rotation = max_tilt_rad * Eigen::Vector3d(unit(random), unit(random), unit(random));
      const Pose<Color, Board> cMo = view(position, rotation);
      const Pose<Base, EndEffector> bMe = flangeFor(cMo);
      if (borderPx(bMe) < margin_px || !guard->allows(bMe)) continue;
      const auto q = kinematics.inverse(bMe, start_q, 0.1);
      if (q && (*q - start_q).cwiseAbs().maxCoeff() < 1.5) return cMo;
    }
    throw std::runtime_error("bench: no view found");
  }
  servo::DriveOutcome drive(const Pose<Color, Board>& cdMo, const servo::CellEstimate& cell,
                            const servo::DriveOptions& options = {}) {
    return servo::drive(*guard, clock, observer, points_o, cdMo, cell, options);
  }

  BoardSpec board;
  robot::Kinematics kinematics;
  SimulatedClock clock;
  std::vector<Eigen::Vector3d> points_o;
  CameraModel camera;
  CameraModel believed;
  Pose<Base, Color> bMc;
  Pose<EndEffector, Board> eMo;
  Eigen::VectorXd start_q;
  FakeArm arm;
  FakeObserver observer;
  std::unique_ptr<robot::Guard> guard;
};

}  // namespace servocal::test
