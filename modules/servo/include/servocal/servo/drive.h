// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/core/observation.h"
#include "servocal/core/pose.h"
#include "servocal/robot/guard.h"

namespace servocal::servo {

/// What one frame showed of the target.
struct Sight {
  Instant stamp{};                      ///< Middle of the exposure.
  std::vector<Eigen::Vector2d> pixels;  ///< One per target point, same order.
  Pose<Color, Board> cMo;               ///< Target pose from those pixels and the current camera model.
};

/// One look through the camera.
struct Look {
  std::optional<Instant> frame;  ///< Stamp of the newest frame; nothing if none came in time.
  std::optional<Sight> sight;    ///< Nothing if that frame does not show the target.
};

/// The eyes of a servo loop.
class Observer {
 public:
  virtual ~Observer() = default;
  /// Waits for the next frame until `deadline` and says what it shows.
  virtual Look look(Instant deadline) = 0;
};

/// What the loop knows of the cell; all of it may be rough. Either a camera that stands in the cell watches a
/// target on the flange, or one on the flange watches a target that stands in the cell.
struct CellEstimate {
  CameraModel camera;
  Mount mount = Mount::kFixed;             ///< Of the camera; decides what the two poses are.
  Pose<EndEffector, Board> eMo;            ///< kFixed: mount of the target; up to about 30 degrees wrong is harmless.
  std::optional<Pose<Base, Color>> bMc;    ///< kFixed: with it, drive() feeds forward to near the goal.
  Pose<EndEffector, Color> eMc;            ///< kFlange: mount of the camera, as rough as eMo may be.
  std::optional<Pose<Base, Board>> bMo;    ///< kFlange: with it, drive() feeds forward.

  /// Where the flange must be for the target to be seen so; nothing without bMc or bMo.
  std::optional<Pose<Base, EndEffector>> flangeFor(const Pose<Color, Board>& cMo) const;
};

struct DriveOptions {
  double gain = 5.0;                  ///< 1/s; of the law near the goal. Far away the speed and acceleration
                                      ///< limits bound it (a braking curve that ends in this exponential).
  std::vector<Eigen::Vector3d> keep_visible_o;  ///< Points in o (m) that must stay in the image, e.g. the
                                      ///< target's outline; the target points themselves if empty.
  double image_margin_px = 25.0;      ///< None of them may come nearer to the image border.
  double still_error_px = 0.5;        ///< Improvements smaller than this (RMS) are left: they are noise.
  double settled_speed_mps = 0.002;   ///< Settled: slower than this,
  double settled_rate_radps = 0.006;  ///< turning slower than this,
  double settled_pixel_rate = 0.3;    ///< and the target's pixels shifting less than this per frame,
  Duration settled_for = std::chrono::milliseconds(200);     ///< for so long.
  double reached_px = 3.0;            ///< RMS error below which a settled drive is kReached, else kPlateau.
  Duration lost_stop = std::chrono::milliseconds(150);       ///< Zero twist so long after the stamp of the
                                      ///< last frame with the target (braking starts with the first without),
  Duration lost_retreat = std::chrono::milliseconds(500);    ///< then back along the path travelled.
  int lost_tries = 3;                 ///< After so many losses the view is kTargetLost. Each try is half as fast.
  Duration timeout = std::chrono::seconds(20);
};

struct DriveOutcome {
  DriveStatus status = DriveStatus::kStopped;
  std::string reason;                 ///< A sentence for the operator.
  std::optional<Sight> last;          ///< The last sight of the target.
  double error_px = 0.0;              ///< RMS distance to the goal's pixels at the end.
  int frames = 0;                     ///< Frames looked at.
  int losses = 0;                     ///< Times the target was lost on the way.
  Duration elapsed{};
};

/// Drives the target to a wanted pose in the image: an image-based visual servo.
///
/// Control law (twist of e in e, eJe = I6; + eye-to-hand, - eye-in-hand):
///   v_e = +-lambda (L cVe)^+ (s - s*),  s the normalized undistorted target points, cVe = Ad(cMe),
/// with L the mean of current and desired interaction matrix, depths from the current target pose. All
/// points count: with 24 corners the law is less than half as noisy as with four. Between and behind the
/// frames, s and cMe are carried on by what the arm has moved since the frame's exposure.
/// With bMc (on the flange: bMo) known, a straight feed-forward move brings the target near the goal first; the camera keeps
/// watching. Every cycle obeys the image border (points slide along the margin) and the guard.
///
/// Ends when the motion has settled, never on an absolute error, and with the arm at rest, whatever the
/// outcome:
/// - kReached, kPlateau: settled, error below or above reached_px. kPlateau also when the time ran out.
/// - kTargetLost: not in sight at the start, or lost lost_tries times, or no (fresh) frames. The arm then
///   stands where the target was last seen, if it could go back there.
/// - kUnreachable: before any motion: the goal is not inside the image margin; or, with bMc known, the arm
///   cannot be there or may not.
/// - kLimit: with bMc known, before any motion: the straight way there is blocked. Or the guard refused for
///   0.5 s. Or the error grew by half and 40 px although the arm obeyed: a sign or frame is wrong.
/// - kStopped: the operator asked to stop.
///
/// Source: Chaumette & Hutchinson, "Visual Servo Control, Part I", IEEE RAM 13(4), 2006, eq. (5), and
/// Part II, 14(1), 2007 (eye-to-hand); ViSP's vpServo, EYETOHAND_L_cVe_eJe and EYEINHAND_L_cVe_eJe.
///
/// @param points_o target points in o, m; at least four, not all on a line.
/// @throws std::invalid_argument for a non-finite goal or cell, or too few points.
/// @throws Error (kHardwareAbsent, kSafetyStop) from the devices; the arm is told to stop.
[[nodiscard]] DriveOutcome drive(robot::Guard& guard, Clock& clock, Observer& observer,
                                 const std::vector<Eigen::Vector3d>& points_o,
                                 const Pose<Color, Board>& cdMo, const CellEstimate& cell,
                                 const DriveOptions& options = {});

/// Moves the flange straight to a pose known from the robot alone (interpolated position and rotation),
/// while the guard watches; for probing motions and returns. Ends at rest: kReached within 0.3 mm and
/// 0.5 mrad; kUnreachable or kLimit before any motion as for drive(); kLimit when the guard refused for
/// 0.5 s; kPlateau when the time ran out; kStopped by the operator.
/// @throws std::invalid_argument if the pose is not finite.
/// @throws Error (kHardwareAbsent, kSafetyStop) from the arm.
[[nodiscard]] DriveOutcome moveTo(robot::Guard& guard, Clock& clock, const Pose<Base, EndEffector>& bMe,
                                  Duration timeout = std::chrono::seconds(20));

}  // namespace servocal::servo
