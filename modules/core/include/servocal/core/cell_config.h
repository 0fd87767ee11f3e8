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
#include "servocal/core/simulation.h"

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
enum class CameraBackend { kSim, kOpenNi2, kFreenect, kV4l2 };
enum class Mount { kFixed, kFlange };  ///< Where a camera is; the board is on the other.

/// How the controller of a Universal Robots arm is reached.
struct UrConfig {
  std::string host;           ///< Name or address.
  std::string serial;         ///< Of the one arm that may move; compared with what the controller says.
  int rtde_port = 30004;
  int dashboard_port = 29999;
  int program_port = 30001;   ///< Primary interface.
};

/// Where the arm looks for the cameras when none sees the board at the start: raised, it turns its first joint.
struct SearchSweep {
  Eigen::VectorXd posture_q;  ///< Joint angles of the raised arm, rad; that of the first joint does not count.
  double from_rad = 0.0;      ///< First joint from here
  double to_rad = 0.0;        ///< to here.
};

struct ArmConfig {
  ArmBackend backend = ArmBackend::kSim;
  std::optional<UrConfig> ur;       ///< There if the backend is kUr.
  std::string urdf = "ur5";         ///< "ur5" (built in) or a file, relative to the cell file.
  std::string base_link = "base";
  std::string flange_link = "tool0";
  Eigen::VectorXd start_q;          ///< Joint angles at the start, rad. Some camera sees the board there, or
  std::optional<SearchSweep> search;  ///< else this sweep finds one.
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

/// Part of an image, px.
struct ImageRegion {
  int x_px = 0;  ///< Of its upper left pixel.
  int y_px = 0;
  int width_px = 0;
  int height_px = 0;
};

/// What is known of a camera before calibration: a data sheet, nothing more.
struct CameraConfig {
  std::string name;
  CameraBackend backend = CameraBackend::kSim;
  std::string device;                 ///< Which one, as the backend names it: serial number, address or
                                      ///< number; empty: the only one. Not of a simulated camera.
  Mount mount = Mount::kFixed;
  int width_px = 1920;                ///< Of the color image.
  int height_px = 1080;
  double horizontal_fov_rad = 1.466;  ///< Nominal.
  double latency_s = 0.065;           ///< Nominal, middle of the exposure to arrival; the run checks it.
  std::optional<InfraredConfig> infrared;
  std::optional<ImageRegion> region;  ///< Of the color image: only this need be covered. Nothing: all of it.
};

/// A distortion-free camera from the data sheet of one stream; depth is the infrared's.
/// @throws std::invalid_argument if the camera has no such stream.
CameraModel nominalModel(const CameraConfig& camera, Stream stream);

/// Goals of the coverage stage.
struct CoverageConfig {
  int cells_x = 8;
  int cells_y = 5;
  int infrared_cells_x = 6;      ///< Of infrared images.
  int infrared_cells_y = 5;
  int corners_per_cell = 12;     ///< Corners that fill an image cell.
  double distance_ratio = 1.2;   ///< Far views are at least this many times as far as near ones.
  double near_distance_m = 0.45; ///< Wanted distance of near views along the optical axis.
  int max_views = 40;            ///< Per camera.
  int revisit_views = 8;         ///< Per camera, facing it, after its coverage.
  int check_views = 3;           ///< Per camera, kept from the solvers: the held-out error.
};

/// Which view is worth most.
enum class Planner {
  kCoverage,     ///< The one that fills most of what its camera has not seen; camera after camera.
  kInformation,  ///< The one that takes away most uncertainty of all cameras per second, above a floor of coverage.
};

/// How views are chosen, and when Planner::kInformation has seen enough.
struct PlannerConfig {
  Planner choose_by = Planner::kCoverage;
  double projection_goal_px = 0.35;  ///< Worst uncertainty of projection over any image, one sigma.
  double point_goal_m = 0.0005;      ///< Worst uncertainty of a point of the workspace, one sigma.
  int max_views = 150;               ///< Stops after the cameras' tilt searches, of all cameras together.
  double max_time_s = 600.0;         ///< From the run's first motion on.
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
  PlannerConfig planner;
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

/// The default cell, embedded in the program: one simulated UR5, two Kinect v2, one Kinect v1.
CellConfig defaultCell();

}  // namespace servocal
