// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/core/pose.h"

namespace servocal {

enum class Stream { kColor, kInfrared, kDepth };
const char* toString(Stream stream);  ///< "color", "infrared", "depth"

/// One board corner found in an image.
struct Corner {
  int id = 0;                       ///< Index into BoardSpec::corners().
  Eigen::Vector2d pixel;            ///< px; (0,0) is the centre of the top-left pixel.
  Eigen::Matrix2d covariance_px2;   ///< From image noise and gradient; px^2.
};

/// A board found in one image. Corners are sorted by id and each id occurs once.
struct BoardDetection {
  std::vector<Corner> corners;
  bool orientation_known = false;  ///< False: ids may be those of the board turned by 180 degrees.
};

/// What the arm reports at one instant.
struct RobotState {
  Instant stamp{};             ///< On the run's clock.
  double device_stamp_s = 0;   ///< The controller's own stamp, s.
  Eigen::VectorXd q;           ///< Joint angles, rad.
  Pose<Base, EndEffector> bMe; ///< From the controller, not from nominal kinematics.
  Twist<Base> twist;           ///< Measured velocity of the end effector.
};

/// Depth at a corner as the paper takes it: median over a square of pixels and a few frames. For reports; a
/// median of quantised values is several times worse than the plane (docs/depth.md).
struct CornerDepth {
  int id = 0;            ///< As Corner::id.
  double depth_m = 0.0;  ///< Raw, along the optical axis.
  int pixels = 0;        ///< Valid ones that went in.
};

/// Raw depth averaged over a patch of the board: the mean residual of a robust plane fit there, put back on
/// the plane at the patch's middle. What the depth correction is solved from.
struct DepthPatch {
  Eigen::Vector2d pixel;  ///< Middle of the patch, px of the depth image.
  double depth_m = 0.0;   ///< Raw, along the optical axis.
  double sigma_m = 0.0;   ///< Standard deviation of depth_m by the scatter of its pixels.
  int pixels = 0;         ///< Over all frames.
};

/// What the depth image said about the board at a settled moment; same pixels as the infrared image.
struct BoardDepth {
  std::vector<CornerDepth> corners;  ///< Those with valid depth around, by id.
  std::vector<DepthPatch> patches;
  double plane_rms_m = 0.0;   ///< Scatter of single pixels about the plane.
  double valid_share = 0.0;   ///< Pixels of the board that carried a depth near the plane, of all.
  int frames = 0;
  std::string image_file;     ///< First frame, 16-bit PNG; relative to the session folder.
};

/// What one stream of one camera saw at a settled moment.
struct StreamObservation {
  std::string camera;          ///< Name in the cell file.
  Stream stream = Stream::kColor;
  Instant stamp{};             ///< Middle of the exposure, on the run's clock.
  double device_stamp_s = 0;
  int width_px = 0;
  int height_px = 0;
  BoardDetection detection;
  std::string image_file;      ///< Relative to the session folder; empty if no image is kept.
  std::optional<BoardDepth> depth;  ///< Infrared views of a camera with depth.
};

/// The unit of everything: one settled moment, arm at rest. Solvers take only observations, so a live
/// run, a recorded session and a folder of images with poses are the same to them.
struct Observation {
  std::int64_t id = 0;   ///< Given by the session; 1, 2, 3, ...
  std::string stage;     ///< "bootstrap", "tilt", "cover", ... or the image's name for a folder.
  std::optional<RobotState> robot;  ///< Nothing for images without robot poses.
  std::vector<StreamObservation> views;  ///< One per camera and stream that saw the board.
};

/// How a drive to a view ended. Every drive ends in one of these.
enum class DriveStatus { kReached, kPlateau, kTargetLost, kUnreachable, kLimit, kStopped };
const char* toString(DriveStatus status);  ///< "reached", "plateau", "target_lost", ...

/// A goal and how it ended, failures included; the planner learns from them.
struct Attempt {
  std::int64_t id = 0;
  std::string stage;
  std::string camera;              ///< Whose image the goal was chosen for.
  Instant start{};
  Instant end{};
  Pose<Color, Board> cdMo;         ///< The wanted board pose in that camera.
  DriveStatus status = DriveStatus::kStopped;
  std::string reason;              ///< A sentence for the operator.
  std::optional<std::int64_t> observation_id;  ///< The observation that was taken there, if any.
};

}  // namespace servocal
