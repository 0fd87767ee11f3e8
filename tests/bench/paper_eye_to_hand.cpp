// SPDX-License-Identifier: GPL-3.0-or-later
#include "paper_eye_to_hand.h"

#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

#include "arm_errors.h"
#include "calib_scene.h"
#include "default_sim.h"
#include "depth_errors.h"
#include "servocal/calib/eye_to_hand.h"
#include "servocal/calib/reprojection.h"
#include "servocal/robot/kinematics.h"

namespace servocal::bench {
namespace {

constexpr double kCornerPx = 0.2;
// Of a robot whose error is all of it independent from stop to stop; and what is so of one whose error is
// smooth.
constexpr double kRobotM = 0.0003, kRobotRad = 0.0005;

/// Facing the camera but for the bootstrap's few degrees: without any turn no estimator that is not told the
/// mount has an answer.
std::vector<Pose<Color, Board>> spiral(int count) {
  std::vector<Pose<Color, Board>> poses;
  for (int i = 0; i < count; ++i) {
    const double z = i % 2 == 0 ? kNearM : kFarM, radius = 0.3 * std::sqrt((i + 0.5) / count),
                 angle = 2.4 * i;
    poses.push_back(Pose<Color, Board>::fromRotationVector(
        0.2 * Eigen::Vector3d(std::cos(1.7 * i), std::sin(1.7 * i), std::sin(2.9 * i)),
        {radius * std::cos(angle), 0.55 * radius * std::sin(angle), z}));
  }
  return poses;
}

sim::Lens kinectLens() {
  sim::Lens lens;
  lens.width_px = 512;
  lens.height_px = 424;
  lens.fx = lens.fy = 366;
  lens.cx = 255.5;
  lens.cy = 211.5;
  return lens;
}

}  // namespace

struct EyeToHandCell::Impl {
  explicit Impl(std::uint64_t its_seed)
      : seed(its_seed), config(test::defaultSimCell()), kinematics(config.arm),
        nominal(sim::makeArmChain(config.arm)), real(sim::realArm(*nominal, config, seed)),
        lens(kinectLens()), draw(seed, "depth"),
        depth(DepthSensor::kTimeOfFlight, SimulatedDepthConfig{}, lens, draw) {
    std::mt19937_64 random(seed);
    Eigen::Matrix3d looking_back;
    looking_back << 0, 0, -1, 1, 0, 0, 0, -1, 0;
    bMc = Pose<Base, Color>(looking_back, config.simulation->cameras[0].position_m) *
          test::randomPose<Color, Color>(random, 0.08, 0.05);
    eMo = config.simulation->nominal_eMo * test::randomPose<Board, Board>(random, 0.3, 0.03);
  }

  /// What an arm with smooth errors says of a flange pose that it really has.
  Pose<Base, EndEffector> reported(const Pose<Base, EndEffector>& bMe) const {
    Pose<Base, EndEffector> aim = bMe;
    for (int i = 0; i < 3; ++i) {
      const auto q = kinematics.inverse(aim, config.arm.start_q);
      if (!q) throw std::runtime_error("a stop is out of the arm's reach");
      const sim::Joints joints = *q;
      const Pose<Base, EndEffector> there(real->forward(joints));
      if (distanceM(there, bMe) < 1e-7) return Pose<Base, EndEffector>(nominal->forward(joints));
      aim = aim * there.inverse() * bMe;
    }
    return aim;
  }

  /// Where the camera measures a point: off along its ray.
  Eigen::Vector3d measured(const Eigen::Vector3d& point, Systematic systematic) const {
    if (systematic == Systematic::kNone) return point;
    return point * (depth.measured(lens.project(point), point.z()) / point.z());
  }

  std::uint64_t seed;
  CellConfig config;
  robot::Kinematics kinematics;
  std::unique_ptr<const sim::ArmChain> nominal, real;
  sim::Lens lens;
  sim::Random draw;
  sim::DepthErrors depth;
  Pose<Base, Color> bMc;
  Pose<EndEffector, Board> eMo;
};

EyeToHandCell::EyeToHandCell(std::uint64_t seed) : impl_(std::make_unique<Impl>(seed)) {}
EyeToHandCell::~EyeToHandCell() = default;
EyeToHandCell::EyeToHandCell(EyeToHandCell&&) noexcept = default;

std::optional<EyeToHandErrors> EyeToHandCell::errors(int count, Systematic systematic) const {
  const Impl& cell = *impl_;
  const BoardSpec& board = cell.config.board;
  const CameraModel camera = test::hdCamera();
  std::mt19937_64 random(cell.seed);
  std::normal_distribution<double> normal;
  const auto noise = [&] {
    const double x = normal(random), y = normal(random), z = normal(random);
    return Eigen::Vector3d(kLateralM * x, kLateralM * y, kDepthM * z);
  };
  const bool smooth = systematic == Systematic::kArmAndDepth;
  const double robot_m = smooth ? cell.config.simulation->repeatability_m / std::sqrt(3.0) : kRobotM;
  const double robot_rad = smooth ? cell.config.simulation->repeatability_rad / std::sqrt(3.0) : kRobotRad;

  std::vector<Observation> observations;
  std::vector<calib::BoardPoint> points;
  for (const Pose<Color, Board>& cMo : spiral(count)) {
    const Pose<Base, EndEffector> bMe = cell.bMc * cMo * cell.eMo.inverse();
    Observation observation;
    observation.id = static_cast<std::int64_t>(observations.size()) + 1;
    observation.robot.emplace();
    observation.robot->bMe = test::disturbed(smooth ? cell.reported(bMe) : bMe, random, robot_m, robot_rad);
    StreamObservation seen;
    seen.camera = test::kCamera;
    seen.width_px = camera.width_px;
    seen.height_px = camera.height_px;
    seen.detection = test::detect(board, camera, cMo, kCornerPx, random);
    observation.views.push_back(seen);
    Eigen::Vector3d in_camera = noise(), in_base = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& corner : board.corners()) {
      in_camera += cell.measured(cMo * corner, systematic) / board.cornerCount();
      in_base += observation.robot->bMe * cell.eMo * corner / board.cornerCount();
    }
    points.push_back({observation.id, in_camera, in_base});
    observations.push_back(std::move(observation));
  }
  const auto affine = calib::solveAffineEyeToHand(points);
  const auto rigid = calib::solveRigidEyeToHand(points);
  const auto ours =
      calib::solveHandEyeReprojection(board, camera, observations, test::kCamera, Stream::kColor);
  if (!affine.result || !rigid.result || !ours.solution) return std::nullopt;

  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  EyeToHandErrors errors{zero, zero, zero, zero};
  constexpr int kPoints = 60;
  std::uniform_real_distribution<double> unit(-1.0, 1.0);
  for (int i = 0; i < kPoints; ++i) {
    const double x = unit(random), y = unit(random), z = unit(random);
    const Eigen::Vector3d point(0.3 * x, 0.17 * y, 0.5 * (kNearM + kFarM) + 0.1 * z);
    const Eigen::Vector3d seen = cell.measured(point, systematic), once = seen + noise();
    const auto add = [&](Eigen::Vector3d& sum, const Eigen::Vector3d& in_base) {
      sum += (cell.bMc.rotation().transpose() * (in_base - cell.bMc * point)).cwiseAbs() / kPoints;
    };
    add(errors.affine_m, affine.result->bAc * seen.homogeneous());
    add(errors.once_more_m, affine.result->bAc * once.homogeneous());
    add(errors.rigid_m, rigid.result->bMi.isometry() * seen);
    add(errors.ours_m, Pose<Base, Color>(ours.solution->camera_pose) * point);
  }
  return errors;
}

}  // namespace servocal::bench
