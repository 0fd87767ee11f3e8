// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/clock.h"
#include "servocal/core/result.h"
#include "servocal/procedure/look.h"
#include "servocal/procedure/solve.h"
#include "servocal/robot/guard.h"
#include "servocal/sensor/rgbd_camera.h"
#include "servocal/session/session.h"

namespace servocal::procedure {

/// The devices of a cell, simulated or real. They must outlive the run.
struct Devices {
  Clock& clock;
  robot::Guard& guard;
  std::vector<sensor::RgbdCamera*> cameras;  ///< Same order as CellConfig::cameras.
};

/// Something the operator may want to see, at most a few per second.
struct Event {
  Instant stamp{};
  std::string stage;                ///< "find", "bootstrap", "tilt", "cover", "revisit", "check", "solve"
  std::string camera;               ///< Whose turn it is, with its stream: "cam1 color".
  int done = 0;                     ///< Views of this stage so far,
  int planned = 0;                  ///< of so many at most.
  std::optional<double> eta_s;      ///< Until the end of the run, simulated or wall time of the run's clock.
  std::optional<double> rms_px;     ///< Reprojection error of the accumulated estimate.
  std::optional<double> scatter_m;  ///< Hand-eye scatter of the accumulated estimate.
  std::string message;
  std::vector<EyeProgress> eyes;    ///< All streams of all cameras that take part.
};
using EventSink = std::function<void(const Event&)>;

/// What a run may leave out.
struct CalibrateOptions {
  std::vector<std::string> cameras;  ///< Only these, by name; all if empty.
  GivenIntrinsics given_intrinsics;  ///< Believed instead of solved.
  std::string arm;                   ///< Model and serial number, kept in the session; it is resumed with no other.
  bool hand_eye_only = false;        ///< No tilt limits, no coverage, no infrared: only where the color cameras stand.
  /// An earlier run of this cell: how the board is mounted and how far it can be tilted are believed instead of
  /// sought. The views of this run correct the mount.
  std::optional<CalibrationResult> known;
};

/// Calibrates the cameras of a cell: those that stand in it while the arm carries the board, or those on the flange
/// while the board stands. The first one that sees it (at the start, or in the search sweep of the cell file)
/// gets the bootstrap by probing motions; then each camera in turn: hand over, tilt limits, coverage by visual
/// servoing (color, then what is left of infrared), revisit without tilting, a few views for the held-out
/// error; at the end one solve. Every settled stop is an observation for every stream that sees the board, and
/// is in the session before anything else uses it. A camera that cannot be served is named in
/// CalibrationResult::missing, and the others go on. Ends with the arm at rest.
/// `on_look` is for who watches; it gets copies and decides nothing.
///
/// A session that holds observations already is resumed: what they say is taken over, a few of its views are looked
/// at again to see that nothing moved meanwhile, and the run goes on at the camera, stage and view where it stopped.
///
/// Source: Miseikis, Glette, Elle, Torresen, "Automatic Calibration of a Robot Manipulator and Multi 3D
/// Camera System", 2016, Algorithm 1.
///
/// @throws Error kInterrupted when the operator stopped the run (the session keeps what was seen),
///   kSafetyStop and kHardwareAbsent from the devices, kBadData from the disk, if something moved since the session
///   to be resumed was interrupted or if the known result says nothing of this cell's mount, kRefusedToMove if arm, cameras or options are not that session's.
CalibrationResult calibrate(const CellConfig& cell, const Devices& devices, session::Session& session,
                            const EventSink& on_event, const CalibrateOptions& options = {},
                            const LookSink& on_look = {});

}  // namespace servocal::procedure
