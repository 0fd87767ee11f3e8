// SPDX-License-Identifier: GPL-3.0-or-later
#include "simulation_config.h"

#include <algorithm>
#include <cmath>

namespace servocal {
namespace {

constexpr double kRadPerDeg = 3.14159265358979323846 / 180.0;
constexpr Range kAnywhere{-100.0, 100.0};  ///< Positions in the cell, m.

std::string namesOf(const std::vector<CameraConfig>& cameras) {
  std::string names;
  for (const CameraConfig& camera : cameras) names += (names.empty() ? "" : ", ") + camera.name;
  return names;
}

double angle(const ConfigReader& section, const char* key_deg, double max_deg, double fallback_rad) {
  return section.number(key_deg, {0.0, max_deg}, fallback_rad / kRadPerDeg) * kRadPerDeg;
}

const std::vector<std::string> kFaultNames = {
    "inkjet_print", "depth_unit",         "clock_offset", "late_delivery", "mount_slip",
    "camera_bump",  "camera_turned_away", "exposure",     "slow_frames"};  ///< In the order of FaultKind.

/// Keys that color and infrared share; those of `sensor` are the defaults.
void readSensor(const ConfigReader& section, SimulatedSensorConfig& sensor) {
  sensor.focal_spread = section.number("focal_spread", {0.0, 0.5}, sensor.focal_spread);
  sensor.principal_point_spread_px =
      section.number("principal_point_spread_px", {0.0, 1000.0}, sensor.principal_point_spread_px);
  sensor.distortion = section.numbers("distortion", 5, {-10.0, 10.0}, sensor.distortion);
  sensor.distortion_spread = section.number("distortion_spread", {0.0, 1.0}, sensor.distortion_spread);
  sensor.rate_hz = section.number("rate_hz", {0.1, 1000.0}, sensor.rate_hz);
  sensor.exposure_s = section.number("exposure_s", {0.0, 1.0}, sensor.exposure_s);
  sensor.latency_s = section.number("latency_s", {0.0, 2.0}, sensor.latency_s);
  sensor.defocus_px = section.number("defocus_px", {0.0, 20.0}, sensor.defocus_px);
  sensor.focus_distance_m = section.number("focus_distance_m", {0.01, 100.0}, sensor.focus_distance_m);
  sensor.defocus_px_per_diopter =
      section.number("defocus_px_per_diopter", {0.0, 20.0}, sensor.defocus_px_per_diopter);
  sensor.noise_gray = section.number("noise_gray", {0.0, 100.0}, sensor.noise_gray);
}

SimulatedDepthConfig readDepth(const ConfigReader& section, SimulatedDepthConfig depth) {
  depth.nearest_m = section.number("nearest_m", {0.0, 20.0}, depth.nearest_m);
  depth.farthest_m = section.number("farthest_m", {0.1, 60.0}, depth.farthest_m);
  depth.noise_m = section.number("noise_m", {0.0, 0.1}, depth.noise_m);
  depth.noise_per_m2 = section.number("noise_per_m2", {0.0, 0.1}, depth.noise_per_m2);
  depth.static_share = section.number("static_share", {0.0, 1.0}, depth.static_share);
  depth.offset_m = section.number("offset_m", {-0.1, 0.1}, depth.offset_m);
  depth.offset_spread_m = section.number("offset_spread_m", {0.0, 0.1}, depth.offset_spread_m);
  depth.slope_spread = section.number("slope_spread", {0.0, 0.1}, depth.slope_spread);
  depth.wiggle_m = section.number("wiggle_m", {0.0, 0.05}, depth.wiggle_m);
  depth.lateral_m = section.number("lateral_m", {0.0, 0.05}, depth.lateral_m);
  depth.black_m = section.number("black_m", {-0.05, 0.05}, depth.black_m);
  depth.baseline_m = section.number("baseline_m", {0.01, 1.0}, depth.baseline_m);
  depth.disparity_step_px = section.number("disparity_step_px", {0.01, 4.0}, depth.disparity_step_px);
  section.finish();
  if (depth.nearest_m >= depth.farthest_m) {
    section.fail("nearest_m", "'nearest_m' must be below 'farthest_m'");
  }
  return depth;
}

SimulatedInfraredConfig readSimulatedInfrared(const ConfigReader& section, const InfraredConfig& known) {
  SimulatedInfraredConfig infrared = SimulatedInfraredConfig::like(known);
  infrared.focal_px = section.number("focal_px", {10.0, 50000.0}, infrared.focal_px);
  readSensor(section, infrared);
  if (section.has("position_c_m")) infrared.position_c_m = section.vector3("position_c_m", {-1.0, 1.0});
  infrared.position_spread_m = section.number("position_spread_m", {0.0, 0.1}, infrared.position_spread_m);
  infrared.rotation_spread_rad = angle(section, "rotation_spread_deg", 20.0, infrared.rotation_spread_rad);
  infrared.black = section.number("black", {0.0, 1.0}, infrared.black);
  infrared.light_range_m = section.number("light_range_m", {0.05, 20.0}, infrared.light_range_m);
  infrared.light_fall = section.number("light_fall", {0.0, 0.95}, infrared.light_fall);
  infrared.projector_dots = section.boolean("projector_dots", infrared.projector_dots);
  if (known.depth) {
    if (const auto depth = section.optionalSection("depth"))
      infrared.depth = readDepth(*depth, infrared.depth);
  }
  section.finish();
  return infrared;
}

SimulatedCameraConfig readSimulatedCamera(const ConfigReader& section,
                                          const std::vector<CameraConfig>& cameras) {
  SimulatedCameraConfig camera;
  camera.name = section.text("name");
  const auto known = std::find_if(cameras.begin(), cameras.end(),
                                  [&](const CameraConfig& other) { return other.name == camera.name; });
  if (known == cameras.end()) {
    section.fail("name", "the cell has no camera '" + camera.name + "'; it has: " + namesOf(cameras));
  }
  camera.position_m = section.vector3("position_m", kAnywhere);
  camera.look_at_m = section.vector3("look_at_m", kAnywhere);
  camera.position_spread_m = section.number("position_spread_m", {0.0, 1.0}, camera.position_spread_m);
  camera.rotation_spread_rad = angle(section, "rotation_spread_deg", 45.0, camera.rotation_spread_rad);
  camera.focal_px = section.number("focal_px", {10.0, 50000.0});
  readSensor(section, camera);
  camera.clock_drift_ppm = section.number("clock_drift_ppm", {0.0, 10000.0}, camera.clock_drift_ppm);
  camera.delivery_jitter_s = section.number("delivery_jitter_s", {0.0, 1.0}, camera.delivery_jitter_s);
  if (known->infrared) {
    camera.switch_s = section.number("switch_s", {0.0, 10.0}, camera.switch_s);
    if (const auto infrared = section.optionalSection("infrared")) {
      camera.infrared = readSimulatedInfrared(*infrared, *known->infrared);
    }
  }
  section.finish();
  if ((camera.position_m - camera.look_at_m).norm() < 0.01) {
    section.fail("look_at_m", "'look_at_m' must differ from 'position_m'; it fixes where the camera looks");
  }
  return camera;
}

template <class A>
Pose<A, Board> readMount(const ConfigReader& section) {
  const Eigen::Vector3d translation_m = section.vector3("translation_m", {-2.0, 2.0});
  const Eigen::Vector3d rotation_vector_deg = section.vector3("rotation_vector_deg", {-360.0, 360.0});
  section.finish();
  return Pose<A, Board>::fromRotationVector(rotation_vector_deg * kRadPerDeg, translation_m);
}

void readMotion(const ConfigReader& section, SimulationFault& fault) {
  constexpr Range any{-1.0, 1.0};
  fault.at_s = section.number("at_s", {0.0, 1e6});
  if (section.has("translation_m")) fault.translation_m = section.vector3("translation_m", any);
  if (section.has("rotation_vector_deg")) {
    fault.rotation_rad = section.vector3("rotation_vector_deg", {-360.0, 360.0}) * kRadPerDeg;
  }
  if (fault.translation_m.isZero() && fault.rotation_rad.isZero()) {
    section.fail("kind", "needs 'translation_m' or 'rotation_vector_deg' that moves something");
  }
}

SimulationFault readFault(const ConfigReader& section, const std::vector<CameraConfig>& cameras) {
  SimulationFault fault;
  fault.kind = static_cast<FaultKind>(section.choice("kind", kFaultNames));
  if (fault.kind != FaultKind::kInkjetPrint && fault.kind != FaultKind::kMountSlip) {
    fault.camera = section.text("camera");
    const auto known = std::find_if(cameras.begin(), cameras.end(),
                                    [&](const CameraConfig& other) { return other.name == fault.camera; });
    if (known == cameras.end()) {
      section.fail("camera", "the cell has no camera '" + fault.camera + "'; it has: " + namesOf(cameras));
    }
    if (fault.kind == FaultKind::kDepthUnit && !(known->infrared && known->infrared->depth)) {
      section.fail("camera", "camera '" + fault.camera + "' has no depth");
    }
  }
  switch (fault.kind) {
    case FaultKind::kInkjetPrint:
    case FaultKind::kCameraTurnedAway: break;
    case FaultKind::kDepthUnit: fault.unit_m = section.number("unit_m", {1e-5, 1.0}); break;
    case FaultKind::kClockOffset: fault.offset_s = section.number("offset_s", {-10.0, 10.0}); break;
    case FaultKind::kLateDelivery: fault.offset_s = section.number("offset_s", {0.0, 10.0}); break;
    case FaultKind::kMountSlip:
    case FaultKind::kCameraBump: readMotion(section, fault); break;
    case FaultKind::kExposure:
      fault.at_s = section.number("at_s", {0.0, 1e6}, 0.0);
      fault.gain = section.number("gain", {0.0, 20.0}, 1.0);
      fault.flicker = section.number("flicker", {0.0, 1.0}, 0.0);
      if (fault.gain == 1.0 && fault.flicker == 0.0) {
        section.fail("kind", "needs a 'gain' other than 1, or 'flicker'");
      }
      break;
    case FaultKind::kSlowFrames:
      fault.at_s = section.number("at_s", {0.0, 1e6}, 0.0);
      fault.rate_hz = section.number("rate_hz", {0.1, 1000.0});
      break;
  }
  section.finish();
  return fault;
}

}  // namespace

SimulationConfig readSimulation(const ConfigReader& section, const std::vector<CameraConfig>& cameras) {
  SimulationConfig simulation;
  simulation.mount_rotation_spread_rad =
      angle(section, "mount_rotation_spread_deg", 180.0, simulation.mount_rotation_spread_rad);
  simulation.mount_translation_spread_m =
      section.number("mount_translation_spread_m", {0.0, 1.0}, simulation.mount_translation_spread_m);
  if (const auto mount = section.optionalSection("nominal_eMo")) {
    simulation.nominal_eMo = readMount<EndEffector>(*mount);
  }
  if (const auto mount = section.optionalSection("nominal_bMo"))
    simulation.nominal_bMo = readMount<Base>(*mount);
  simulation.repeatability_m = section.number("repeatability_m", {0.0, 0.1}, simulation.repeatability_m);
  simulation.repeatability_rad = angle(section, "repeatability_deg", 5.0, simulation.repeatability_rad);
  simulation.accuracy_m = section.number("accuracy_m", {0.0, 0.1}, simulation.accuracy_m);
  simulation.max_joint_speed_radps =
      section.number("max_joint_speed_radps", {0.01, 20.0}, simulation.max_joint_speed_radps);
  simulation.max_joint_acceleration_radps2 = section.number("max_joint_acceleration_radps2", {0.1, 1000.0},
                                                            simulation.max_joint_acceleration_radps2);
  simulation.light_gradient = section.number("light_gradient", {0.0, 0.95}, simulation.light_gradient);
  simulation.specular = section.number("specular", {0.0, 1.0}, simulation.specular);
  simulation.clutter = section.boolean("clutter", simulation.clutter);
  simulation.wall_distance_m = section.number("wall_distance_m", {0.1, 20.0}, simulation.wall_distance_m);
  for (const ConfigReader& camera_section : section.sections("cameras")) {
    const SimulatedCameraConfig camera = readSimulatedCamera(camera_section, cameras);
    if (std::any_of(simulation.cameras.begin(), simulation.cameras.end(),
                    [&](const SimulatedCameraConfig& other) { return other.name == camera.name; })) {
      camera_section.fail("name", "simulated camera '" + camera.name + "' is there twice");
    }
    simulation.cameras.push_back(camera);
  }
  if (section.has("faults")) {
    for (const ConfigReader& fault : section.sections("faults")) {
      simulation.faults.push_back(readFault(fault, cameras));
    }
  }
  section.finish();
  for (const CameraConfig& camera : cameras) {
    const bool described =
        std::any_of(simulation.cameras.begin(), simulation.cameras.end(),
                    [&](const SimulatedCameraConfig& other) { return other.name == camera.name; });
    if (camera.backend == CameraBackend::kSim && !described) {
      section.fail("cameras", "camera '" + camera.name + "' has the backend 'sim' but is missing in " +
                                  "'simulation.cameras'");
    }
  }
  return simulation;
}

const char* toString(FaultKind kind) { return kFaultNames.at(static_cast<std::size_t>(kind)).c_str(); }

SimulatedInfraredConfig SimulatedInfraredConfig::like(const InfraredConfig& infrared) {
  SimulatedInfraredConfig like;
  like.focal_px = 0.5 * infrared.width_px / std::tan(0.5 * infrared.horizontal_fov_rad);
  like.principal_point_spread_px = 0.0125 * infrared.width_px;
  like.distortion = {0.09, -0.27, 0.0004, -0.0003, 0.09};
  like.exposure_s = 0.010;
  like.latency_s = 0.050;
  like.defocus_px = 0.7;
  like.defocus_px_per_diopter = 0.2;
  like.noise_gray = 4.0;
  if (infrared.depth == DepthSensor::kStructuredLight) {
    like.distortion = {-0.09, 0.25, 0.0005, -0.0004, -0.15};
    like.exposure_s = 0.020;
    like.defocus_px = 0.9;
    like.noise_gray = 6.0;
    like.position_c_m = {0.025, 0.0, 0.0};
    like.depth.nearest_m = 0.4;
    like.depth.noise_m = 0.0012;
    like.depth.noise_per_m2 = 0.0019;
    like.depth.offset_m = 0.0;
    like.depth.offset_spread_m = 0.008;
    like.depth.slope_spread = 0.008;
    like.depth.wiggle_m = 0.0;
    like.depth.lateral_m = 0.003;
    like.depth.black_m = 0.0;
  }
  return like;
}

}  // namespace servocal
