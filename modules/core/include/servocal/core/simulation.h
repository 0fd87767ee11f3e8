// SPDX-License-Identifier: GPL-3.0-or-later
// The truth of a simulated cell and its difficulty. Read by `sim` and the tests' truth alone; a calibration
// run never sees these numbers. "Drawn" means: each seed's own.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/pose.h"

namespace servocal {

struct InfraredConfig;

/// What a color and an infrared camera have in common. Defaults are a Kinect v2's color camera.
struct SimulatedSensorConfig {
  double focal_px = 1066.0;
  double focal_spread = 0.02;  ///< Relative, +-; drawn.
  double principal_point_spread_px = 12.0;
  std::vector<double> distortion = {0.09, -0.12, 0.0006, -0.0004, 0.03};  ///< k1 k2 p1 p2 k3
  double distortion_spread = 0.1;  ///< Relative, +-; |k1| stays at least 0.04.
  double rate_hz = 30.0;
  double exposure_s = 0.020;
  double latency_s = 0.045;  ///< End of exposure to delivery.
  double defocus_px = 0.9;   ///< Standard deviation of the point spread in focus, px.
  double focus_distance_m = 0.7;
  double defocus_px_per_diopter = 0.6;  ///< Added (in quadrature) per 1/m off the focus distance.
  double noise_gray = 7.0;              ///< Standard deviation at mid gray; of 255.
};

/// What is wrong with a depth image. Systematic errors are drawn once per seed; their shapes are the
/// simulator's own (modules/sim/README.md). Defaults are a Kinect v2's.
struct SimulatedDepthConfig {
  double nearest_m = 0.5;  ///< Pixels outside this range are invalid (0).
  double farthest_m = 4.5;
  double noise_m = 0.0015;           ///< Standard deviation near the axis, board facing the camera ...
  double noise_per_m2 = 0.0;         ///< ... plus this times (z - 0.4 m)^2.
  double static_share = 0.3;         ///< Of the noise's variance: the same in every frame.
  double offset_m = 0.024;           ///< Measured minus true at 1 m ...
  double offset_spread_m = 0.004;    ///< ... drawn within +- this of it.
  double slope_spread = 0.004;       ///< Error per metre of range, +-; drawn.
  double wiggle_m = 0.0010;          ///< Amplitude of the error that is periodic in range; time of flight.
  double lateral_m = 0.0020;         ///< RMS over the image of a smooth error, at 1 m.
  double black_m = 0.001;            ///< Black measures farther than white by this; time of flight.
  double baseline_m = 0.075;         ///< Projector to infrared camera; structured light.
  double disparity_step_px = 0.125;  ///< Quantisation of the disparity; structured light.
};

/// The infrared and depth side of a simulated camera. Depth shares the infrared image's exposures and pixels.
struct SimulatedInfraredConfig : SimulatedSensorConfig {
  Eigen::Vector3d position_c_m = {-0.052, 0.0, 0.0};  ///< Nominal origin of i in c; axes parallel.
  double position_spread_m = 0.002;                   ///< Drawn within +- this, per axis,
  double rotation_spread_rad = 0.010;                 ///< ... and a rotation up to this angle.
  double black = 0.20;          ///< Reflectance of the print's black over that of its white.
  double light_range_m = 0.7;   ///< White is at 165 gray there; the camera's own light falls with
                                ///< distance squared, partly made up for by its gain.
  double light_fall = 0.45;     ///< Relative fall of that light from the middle to the image's corners.
  bool projector_dots = false;  ///< Structured light: the projector is not blocked in infrared images.
  SimulatedDepthConfig depth;

  /// A Kinect v2's (time of flight) or v1's (structured light), whichever measures depth like `infrared`,
  /// with the focal length of its field of view.
  static SimulatedInfraredConfig like(const InfraredConfig& infrared);
};

/// Geometry of one simulated camera, and how far each seed may move it.
struct SimulatedCameraConfig : SimulatedSensorConfig {
  std::string name;  ///< Of the camera in CellConfig::cameras.
  Eigen::Vector3d position_m =
      Eigen::Vector3d::Zero();  ///< Nominal camera origin in b, or in e on the flange.
  Eigen::Vector3d look_at_m = Eigen::Vector3d::Zero();  ///< Nominal point on the optical axis, same frame.
  double position_spread_m = 0.05;    ///< Each seed draws uniformly within +- this, per axis,
  double rotation_spread_rad = 0.08;  ///< ... and a rotation up to this angle.
  double clock_drift_ppm = 20.0;      ///< Of the camera's own clock, drawn within +- this.
  double delivery_jitter_s = 0.0;     ///< Frames come up to this later than their latency says.
  double switch_s = 0.3;              ///< From color to infrared and back, if they exclude each other.
  std::optional<SimulatedInfraredConfig> infrared;  ///< Nothing: SimulatedInfraredConfig::like.
};

/// What goes wrong in a simulated cell, on purpose.
enum class FaultKind {
  kInkjetPrint,       ///< The board's black vanishes in infrared.
  kDepthUnit,         ///< A camera's depth image is in `unit_m` instead of mm.
  kClockOffset,       ///< A camera's stamps, the device's own included, are `offset_s` too late.
  kLateDelivery,      ///< A camera's frames arrive `offset_s` later than its latency says.
  kMountSlip,         ///< At `at_s` the board shifts by `translation_m` and turns on what holds it.
  kCameraBump,        ///< At `at_s` a camera is moved, by a shift and a rotation in its own axes.
  kCameraTurnedAway,  ///< A camera looks the other way from the start: it never sees the board.
  kExposure,          ///< From `at_s` on a camera's grays are `gain` times as bright, each frame by another
                      ///< factor within `flicker` of it.
  kSlowFrames,        ///< From `at_s` on so many of a camera's frames are lost that `rate_hz` are left.
};
const char* toString(FaultKind kind);  ///< "inkjet_print", "depth_unit", "clock_offset", ...

struct SimulationFault {
  FaultKind kind = FaultKind::kInkjetPrint;
  std::string camera;                                       ///< Empty for those of the board.
  double at_s = 0.0;                                        ///< On the run's clock.
  Eigen::Vector3d translation_m = Eigen::Vector3d::Zero();  ///< In e (in b if the board is fixed), or in c.
  Eigen::Vector3d rotation_rad = Eigen::Vector3d::Zero();   ///< Rotation vector, about the body's own origin.
  double offset_s = 0.0;
  double unit_m = 0.001;
  double gain = 1.0;
  double flicker = 0.0;  ///< Share of gain.
  double rate_hz = 0.0;
};

struct SimulationConfig {
  double mount_rotation_spread_rad = 0.52;   ///< Board mount against nominal, per seed: angle up to this
  double mount_translation_spread_m = 0.05;  ///< and distance up to this.
  Pose<EndEffector, Board> nominal_eMo = Pose<EndEffector, Board>::identity();  ///< Board on the flange.
  std::optional<Pose<Base, Board>>
      nominal_bMo;                     ///< Board in the cell; needed if the cameras are on the flange.
  double repeatability_m = 0.0001;     ///< RMS length of the position error between visits.
  double repeatability_rad = 0.00035;  ///< 0.02 degrees.
  double accuracy_m = 0.0003;          ///< RMS over the workspace, beyond repeatability.
  double max_joint_speed_radps = 3.14;
  double max_joint_acceleration_radps2 = 15.0;
  double light_gradient = 0.3;  ///< Relative fall of the light across the image.
  double specular = 0.35;       ///< Strength of the highlight of the board's surface.
  bool clutter = true;
  double wall_distance_m = 2.5;  ///< Of what is behind, from each camera.
  std::vector<SimulatedCameraConfig> cameras;
  std::vector<SimulationFault> faults;
};

}  // namespace servocal
