// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera_truth.h"

#include <cmath>
#include <stdexcept>

#include "faults.h"

namespace servocal::sim {
namespace {

/// A camera at `position` that looks at a point, its image upright: y against `up` as far as it can be.
Eigen::Isometry3d lookAt(const Eigen::Vector3d& position, const Eigen::Vector3d& target,
                         const Eigen::Vector3d& up) {
  const Eigen::Vector3d z = (target - position).normalized();
  const Eigen::Vector3d x = z.cross(up).normalized();
  if (!z.allFinite() || !x.allFinite()) {
    throw std::invalid_argument(
        "sim::Cell: a simulated camera must look at another point, not along z (on the flange: not along y)");
  }
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() << x, z.cross(x), z;
  pose.translation() = position;
  return pose;
}

Light drawLight(const SimulationConfig& simulation, const Lens& lens, const Eigen::Isometry3d& bMc,
                Random& random) {
  Light light;
  light.specular = simulation.specular;
  // A lamp above and behind the camera, off to a side.
  const Eigen::Vector3d back = -bMc.linear().col(2), side = bMc.linear().col(0);
  const Eigen::Vector3d towards =
      0.7 * back + random.uniform(-0.5, 0.5) * side + random.uniform(0.5, 0.9) * Eigen::Vector3d::UnitZ();
  light.towards_c = bMc.linear().transpose() * towards.normalized();
  // The light falls from 1 to 1 - gradient from one end of the image's diagonal circle to the other.
  const double angle = random.uniform(0.0, 2.0 * M_PI);
  const Eigen::Vector2d direction(std::cos(angle), std::sin(angle));
  const Eigen::Vector2d centre(0.5 * lens.width_px, 0.5 * lens.height_px);
  light.fall_per_px = direction * simulation.light_gradient / (2.0 * centre.norm());
  light.fall_at_origin = 0.5 * simulation.light_gradient - light.fall_per_px.dot(centre);
  return light;
}

InfraredTruth drawInfrared(const CameraConfig& camera, const SimulatedCameraConfig& simulated,
                           const SimulationConfig& simulation, std::uint64_t seed) {
  InfraredTruth truth;
  truth.config = simulated.infrared.value_or(SimulatedInfraredConfig::like(*camera.infrared));
  Random lens_random(seed, "infrared lens " + camera.name);
  truth.lens = Lens::draw(truth.config, camera.infrared->width_px, camera.infrared->height_px, lens_random);
  Random pose_random(seed, "infrared pose " + camera.name);
  truth.cMi.setIdentity();
  truth.cMi.translation() = truth.config.position_c_m + pose_random.box(truth.config.position_spread_m);
  const Eigen::Vector3d axis = pose_random.direction();
  truth.cMi.linear() =
      Eigen::AngleAxisd(pose_random.uniform(0.0, truth.config.rotation_spread_rad), axis).toRotationMatrix();
  truth.phase_s = pose_random.uniform(0.0, 1.0 / truth.config.rate_hz);

  truth.light.towards_c = -Eigen::Vector3d::UnitZ();
  truth.light.fall_per_px.setZero();
  truth.light.specular = simulation.specular;
  ActiveLight active;
  active.range_m = truth.config.light_range_m;
  active.centre_px = {0.5 * truth.lens.width_px, 0.5 * truth.lens.height_px};
  active.fall_per_px2 = truth.config.light_fall / active.centre_px.squaredNorm();
  truth.light.active = active;

  if (camera.infrared->depth) {
    Random depth_random(seed, "depth " + camera.name);
    truth.depth.emplace(*camera.infrared->depth, truth.config.depth, truth.lens, depth_random);
  }
  return truth;
}

void applyFaults(SteppedPose& pose, const std::string& camera, const SimulationConfig& simulation) {
  for (const SimulationFault& fault : faultsInOrder(simulation)) {
    if (fault.camera != camera) continue;
    if (fault.kind == FaultKind::kCameraBump) {
      Eigen::Isometry3d bump = Eigen::Isometry3d::Identity();
      bump.linear() = rotation(fault.rotation_rad);
      bump.translation() = fault.translation_m;
      pose.step(Instant(fromSeconds(fault.at_s)), pose.last() * bump);
    } else if (fault.kind == FaultKind::kCameraTurnedAway) {
      Eigen::Isometry3d turned = pose.last();
      turned.linear() = turned.linear() * rotation({0.0, M_PI, 0.0});
      pose.step(Instant::min(), turned);
    }
  }
}

}  // namespace

CameraTruth drawCamera(const CameraConfig& camera, const SimulatedCameraConfig& simulated,
                       const SimulationConfig& simulation, std::uint64_t seed) {
  Random lens_random(seed, "lens " + camera.name);
  Random pose_random(seed, "pose " + camera.name);
  Random light_random(seed, "light " + camera.name);
  // The flange's z points away from the arm: a camera there looks along it, its image's y along the flange's.
  const Eigen::Vector3d up = camera.mount == Mount::kFixed ? Eigen::Vector3d(Eigen::Vector3d::UnitZ())
                                                           : Eigen::Vector3d(-Eigen::Vector3d::UnitY());
  const Lens lens = Lens::draw(simulated, camera.width_px, camera.height_px, lens_random);
  Eigen::Isometry3d pose = lookAt(simulated.position_m, simulated.look_at_m, up);
  pose.translation() += pose_random.box(simulated.position_spread_m);
  const Eigen::Vector3d axis = pose_random.direction();
  const double angle = pose_random.uniform(0.0, simulated.rotation_spread_rad);
  pose.linear() = pose.linear() * Eigen::AngleAxisd(angle, axis);
  CameraTruth truth{lens, SteppedPose(pose), drawLight(simulation, lens, pose, light_random), {}};
  if (camera.infrared) truth.infrared = drawInfrared(camera, simulated, simulation, seed);
  applyFaults(truth.pose, camera.name, simulation);
  return truth;
}

}  // namespace servocal::sim
