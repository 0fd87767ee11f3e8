// SPDX-License-Identifier: GPL-3.0-or-later
#include "simulation_config.h"

#include <algorithm>

namespace servocal {
namespace {

constexpr double kRadPerDeg = 3.14159265358979323846 / 180.0;
constexpr Range kAnywhere{-100.0, 100.0};  ///< Positions in the cell, m.

double angle(const ConfigReader& section, const char* key_deg, double max_deg, double fallback_rad) {
  return section.number(key_deg, {0.0, max_deg}, fallback_rad / kRadPerDeg) * kRadPerDeg;
}

SimulatedCameraConfig readSimulatedCamera(const ConfigReader& section) {
  SimulatedCameraConfig camera;
  camera.name = section.text("name");
  camera.position_m = section.vector3("position_m", kAnywhere);
  camera.look_at_m = section.vector3("look_at_m", kAnywhere);
  camera.position_spread_m = section.number("position_spread_m", {0.0, 1.0}, camera.position_spread_m);
  camera.rotation_spread_rad = angle(section, "rotation_spread_deg", 45.0, camera.rotation_spread_rad);
  camera.focal_px = section.number("focal_px", {10.0, 50000.0});
  camera.focal_spread = section.number("focal_spread", {0.0, 0.5}, camera.focal_spread);
  camera.principal_point_spread_px =
      section.number("principal_point_spread_px", {0.0, 1000.0}, camera.principal_point_spread_px);
  camera.distortion = section.numbers("distortion", 5, {-10.0, 10.0}, camera.distortion);
  camera.distortion_spread = section.number("distortion_spread", {0.0, 1.0}, camera.distortion_spread);
  camera.rate_hz = section.number("rate_hz", {0.1, 1000.0}, camera.rate_hz);
  camera.exposure_s = section.number("exposure_s", {0.0, 1.0}, camera.exposure_s);
  camera.latency_s = section.number("latency_s", {0.0, 2.0}, camera.latency_s);
  camera.defocus_px = section.number("defocus_px", {0.0, 20.0}, camera.defocus_px);
  camera.focus_distance_m = section.number("focus_distance_m", {0.01, 100.0}, camera.focus_distance_m);
  camera.defocus_px_per_diopter =
      section.number("defocus_px_per_diopter", {0.0, 20.0}, camera.defocus_px_per_diopter);
  camera.noise_gray = section.number("noise_gray", {0.0, 100.0}, camera.noise_gray);
  section.finish();
  if ((camera.position_m - camera.look_at_m).norm() < 0.01) {
    section.fail("look_at_m", "'look_at_m' must differ from 'position_m'; it fixes where the camera looks");
  }
  return camera;
}

Pose<EndEffector, Board> readMount(const ConfigReader& section) {
  const Eigen::Vector3d translation_m = section.vector3("translation_m", {-2.0, 2.0});
  const Eigen::Vector3d rotation_vector_deg = section.vector3("rotation_vector_deg", {-360.0, 360.0});
  section.finish();
  return Pose<EndEffector, Board>::fromRotationVector(rotation_vector_deg * kRadPerDeg, translation_m);
}

}  // namespace

SimulationConfig readSimulation(const ConfigReader& section, const std::vector<CameraConfig>& cameras) {
  SimulationConfig simulation;
  simulation.mount_rotation_spread_rad =
      angle(section, "mount_rotation_spread_deg", 180.0, simulation.mount_rotation_spread_rad);
  simulation.mount_translation_spread_m =
      section.number("mount_translation_spread_m", {0.0, 1.0}, simulation.mount_translation_spread_m);
  if (const auto mount = section.optionalSection("nominal_eMo")) simulation.nominal_eMo = readMount(*mount);
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
  for (const ConfigReader& camera_section : section.sections("cameras")) {
    const SimulatedCameraConfig camera = readSimulatedCamera(camera_section);
    const auto named = [&](const auto& other) { return other.name == camera.name; };
    if (std::none_of(cameras.begin(), cameras.end(), named)) {
      std::string names;
      for (const CameraConfig& other : cameras) names += (names.empty() ? "" : ", ") + other.name;
      camera_section.fail("name", "the cell has no camera '" + camera.name + "'; it has: " + names);
    }
    if (std::any_of(simulation.cameras.begin(), simulation.cameras.end(), named)) {
      camera_section.fail("name", "simulated camera '" + camera.name + "' is there twice");
    }
    simulation.cameras.push_back(camera);
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

}  // namespace servocal
