// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"
#include "servocal/core/pose.h"

namespace servocal {

/// Axis-aligned box in the robot base, m.
struct Box {
  std::string name;
  Eigen::Vector3d min_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d max_m = Eigen::Vector3d::Zero();

  bool contains(const Eigen::Vector3d& point_b) const {
    return (point_b.array() >= min_m.array()).all() && (point_b.array() <= max_m.array()).all();
  }
};

/// Limits of motion, enforced by the guard. Defaults are the default cell's.
struct MotionLimits {
  double max_speed_mps = 0.25;             ///< Of the flange and of every board corner.
  double max_angular_speed_radps = 0.5;
  double max_acceleration_mps2 = 1.2;      ///< Of the flange.
  double max_angular_acceleration_radps2 = 2.4;
  double max_joint_speed_radps = 1.0;      ///< Of any joint.
  double joint_margin_rad = 0.05;          ///< Kept from the joint limits of the URDF.
  Box workspace;                           ///< Where flange and board may be.
  std::vector<Box> keep_out;               ///< Where neither flange nor board may be.
};

enum class ArmBackend { kSim, kUr };
enum class CameraBackend { kSim };
enum class Mount { kFixed, kFlange };  ///< Where a camera is; the board is on the other.

/// How the controller of a Universal Robots arm is reached.
struct UrConfig {
  std::string host;           ///< Name or address.
  std::string serial;         ///< Of the one arm that may move; compared with what the controller says.
  int rtde_port = 30004;
  int dashboard_port = 29999;
  int program_port = 30001;   ///< Primary interface.
};

struct ArmConfig {
  ArmBackend backend = ArmBackend::kSim;
  std::optional<UrConfig> ur;       ///< There if the backend is kUr.
  std::string urdf = "ur5";         ///< "ur5" (built in) or a file, relative to the cell file.
  std::string base_link = "base";
  std::string flange_link = "tool0";
  Eigen::VectorXd start_q;          ///< Joint angles at the start, rad. The camera sees the board there.
  double accuracy_m = 0.0003;       ///< Declared robot noise of the estimators: 1 sigma per axis,
  double accuracy_rad = 0.0005;     ///< over the volume (not the repeatability).
};

/// How a camera measures depth; decides the form of its depth correction.
enum class DepthSensor { kStructuredLight, kTimeOfFlight };
const char* toString(DepthSensor sensor);  ///< "structured_light", "time_of_flight"

/// The infrared side of an RGB-D camera. Its depth image, if it has one, shares the infrared image's pixels.
struct InfraredConfig {
  int width_px = 512;
  int height_px = 424;
  double horizontal_fov_rad = 1.22;   ///< Nominal.
  std::optional<DepthSensor> depth;   ///< Nothing: infrared only.
  bool excludes_color = false;        ///< Color and infrared cannot run at once (Kinect v1): they take turns
                                      ///< at every stop, while everything stands still.
};

/// What is known of a camera before calibration: a data sheet, nothing more.
struct CameraConfig {
  std::string name;
  CameraBackend backend = CameraBackend::kSim;
  Mount mount = Mount::kFixed;
  int width_px = 1920;                ///< Of the color image.
  int height_px = 1080;
  double horizontal_fov_rad = 1.466;  ///< Nominal.
  double latency_s = 0.065;           ///< Nominal, middle of the exposure to arrival; the run checks it.
  std::optional<InfraredConfig> infrared;
};

/// A distortion-free camera from the data sheet of one stream; depth is the infrared's.
/// @throws std::invalid_argument if the camera has no such stream.
CameraModel nominalModel(const CameraConfig& camera, Stream stream);

/// Goals of the coverage stage.
struct CoverageConfig {
  int cells_x = 8;
  int cells_y = 5;
  int corners_per_cell = 12;     ///< Corners that fill an image cell.
  double distance_ratio = 1.2;   ///< Far views are at least this many times as far as near ones.
  double near_distance_m = 0.45; ///< Wanted distance of near views along the optical axis.
  int max_views = 40;
};

/// Geometry of one simulated camera, and how far each seed may move it. Read by `sim` alone.
struct SimulatedCameraConfig {
  std::string name;                    ///< Of the camera in CellConfig::cameras.
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();  ///< Nominal camera origin in b.
  Eigen::Vector3d look_at_m = Eigen::Vector3d::Zero();   ///< Nominal point on the optical axis, in b.
  double position_spread_m = 0.05;     ///< Each seed draws uniformly within +- this, per axis.
  double rotation_spread_rad = 0.08;   ///< ... and a rotation up to this angle.
  double focal_px = 1066.0;
  double focal_spread = 0.02;          ///< Relative, +-.
  double principal_point_spread_px = 12.0;
  std::vector<double> distortion = {0.09, -0.12, 0.0006, -0.0004, 0.03};  ///< k1 k2 p1 p2 k3
  double distortion_spread = 0.1;      ///< Relative, +-; |k1| stays at least 0.04.
  double rate_hz = 30.0;
  double exposure_s = 0.020;
  double latency_s = 0.045;            ///< End of exposure to delivery.
  double defocus_px = 0.9;             ///< Standard deviation of the point spread in focus, px.
  double focus_distance_m = 0.7;
  double defocus_px_per_diopter = 0.6; ///< Added (in quadrature) per 1/m off the focus distance.
  double noise_gray = 7.0;             ///< Standard deviation at mid gray; of 255.
};

/// The simulated cell's truth and difficulty. A calibration run never sees these numbers.
struct SimulationConfig {
  double mount_rotation_spread_rad = 0.52;  ///< Board mount against nominal, per seed: angle up to this
  double mount_translation_spread_m = 0.05; ///< and distance up to this.
  Pose<EndEffector, Board> nominal_eMo = Pose<EndEffector, Board>::identity();
  double repeatability_m = 0.0001;      ///< RMS length of the position error between visits.
  double repeatability_rad = 0.00035;   ///< 0.02 degrees.
  double accuracy_m = 0.0003;           ///< RMS over the workspace, beyond repeatability.
  double max_joint_speed_radps = 3.14;
  double max_joint_acceleration_radps2 = 15.0;
  double light_gradient = 0.3;          ///< Relative fall of the light across the image.
  double specular = 0.35;               ///< Strength of the highlight of the board's surface.
  bool clutter = true;
  std::vector<SimulatedCameraConfig> cameras;
};

/// Everything a cell file says. Lengths m, angles rad (files use degrees where keys end in _deg).
struct CellConfig {
  std::string name;
  std::filesystem::path file;  ///< Where it was read from; empty for the embedded default.
  BoardSpec board;
  ArmConfig arm;
  MotionLimits limits;
  std::vector<CameraConfig> cameras;
  CoverageConfig coverage;
  std::optional<SimulationConfig> simulation;
  std::string text;            ///< The file's text, kept in the session for provenance.
};

/// Reads a cell file.
/// @throws Error (kInvalidConfig) with file, line, nearest valid key and allowed range for an unknown
///   key, a missing key, a wrong type or a value out of range.
CellConfig loadCell(const std::filesystem::path& file);

/// The same from a text, e.g. one kept in a session; `origin` names it in messages. A URDF file that it
/// names is relative to the current folder.
CellConfig parseCell(const std::string& text, const std::string& origin);

/// The default cell, embedded in the program: one simulated UR5, one Kinect-v2-like color camera.
CellConfig defaultCell();

}  // namespace servocal
