// SPDX-License-Identifier: GPL-3.0-or-later
// What the stages of a run share: the devices, what was observed, and what is believed so far.
#pragma once

#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "eye.h"
#include "servocal/calib/reprojection.h"
#include "servocal/core/mount.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/procedure/solve.h"
#include "servocal/servo/drive.h"

namespace servocal::procedure {

class Run {
 public:
  Run(const CellConfig& cell, const Devices& devices, session::Session& session, const EventSink& on_event,
      const CalibrateOptions& options, const LookSink& on_look);

  Run(const Run&) = delete;  // The eyes ask this very object where the board is.
  Run& operator=(const Run&) = delete;

  /// Takes an observation for every eye that sees the board: waits until the arm stands still, averages a few
  /// frames taken since, stores it and counts its views. Nothing if `wanted` does not see the board in most of
  /// them, or if anything still moves.
  std::optional<Observation> observe(const std::string& stage, Eye& wanted);

  /// A drive, and what was observed where it ended.
  struct Visit {
    servo::DriveOutcome drive;
    std::optional<Observation> observation;
  };
  /// Drives the board to a view of an eye that knows where it stands, observes there if it arrived, and stores
  /// the attempt. Eyes that have not seen the board yet look on.
  Visit visit(const std::string& stage, Eye& eye, const Pose<Color, Board>& cdMo, servo::DriveOptions options = {});
  /// Moves the flange straight to a pose, on robot states alone; a sentence if it did not get there.
  std::optional<std::string> moveTo(const Pose<Base, EndEffector>& bMe);
  /// Brings the flange to a pose on a way round what is there, in whichever posture of the arm; a sentence if
  /// there is no way or it did not get there.
  std::optional<std::string> travelTo(const Pose<Base, EndEffector>& bMe);
  /// Where the last drive of this eye lost the board, the arm goes back to where it saw it best.
  void backInSight(Eye& eye);
  /// Keeps the arm's path and where the eye saw the board on it, to compare their clocks.
  void noteMotion(Eye& eye, const servo::Look& look);
  /// Lets the eyes that do not know where they stand look, at most three times a second, and note where they
  /// saw the board.
  void lookOn();

  /// What an earlier run of this session observed; before anything else is.
  void takeOver(std::vector<Observation> observations) { observations_ = std::move(observations); }
  /// A line in the session's log.
  void log(const std::string& kind, const std::string& message) { session_.event(clock().now(), kind, message); }
  /// Reports progress.
  void report(const std::string& stage, const Eye& eye, int done, int planned, const std::string& message = {});
  /// All eyes, for those who watch.
  std::vector<EyeProgress> progress() const;
  void setEta(std::optional<double> eta_s) { eta_s_ = eta_s; }

  const CellConfig& cell() const { return cell_; }
  Mount mount() const { return cell_.cameras.front().mount; }  ///< Of all cameras.
  const CalibrateOptions& options() const { return options_; }
  robot::Guard& guard() { return devices_.guard; }
  Clock& clock() { return devices_.clock; }
  const std::vector<Observation>& observations() const { return observations_; }

  std::deque<Eye>& eyes() { return eyes_; }
  /// Nothing if the camera has no such stream.
  Eye* find(const std::string& camera, Stream stream);

  /// Where the board sits on the flange, by the eye that knows best; nothing before the bootstrap.
  const std::optional<Pose<EndEffector, Board>>& eMo() const { return eMo_; }
  /// The same as this eye sees it: its errors go with those of its bMc.
  Pose<EndEffector, Board> eMo(const Eye& eye) const;
  /// Where the flange must be for the board to be seen like this.
  Pose<Base, EndEffector> flangeFor(const Eye& eye, const Pose<Color, Board>& cMo) const {
    return forMount(mount(), *eye.bMc() * cMo * eMo(eye).inverse());
  }

  /// Re-estimates an eye's intrinsics (with the data sheet as a prior) and where it stands from everything
  /// seen; where the views do not determine that yet, from the mount that other eyes found. A sentence if
  /// neither is possible.
  std::optional<std::string> updateBelief(Eye& eye);
  /// Takes over where an eye stands and the board sits.
  void believe(Eye& eye, HandEyeSolution solution);
  /// Takes over where the board sits from elsewhere, if no eye has found it yet.
  void believeMount(const HandEyeSolution& solution);
  /// @throws Error (kInterrupted) if the operator asked to stop.
  void throwIfStopped() const;

 private:
  struct Goal {
    const Eye* eye;
    Pose<Color, Board> cdMo;
  };

  void show(Eye& eye, const SeenFrame& seen);
  std::vector<Eye*> lookersBeside(Eye& wanted, bool excluded_streams);
  void believeFromMount(Eye& eye);
  void keepClearOfWhatIsKnown();

  const CellConfig& cell_;
  Devices devices_;
  session::Session& session_;
  const EventSink& on_event_;
  const CalibrateOptions& options_;
  const LookSink& on_look_;
  std::deque<sensor::GatedCamera> cameras_;  // What the eyes look through.
  std::deque<Eye> eyes_;
  std::vector<RobotState> path_;  // Of the last drives, forMount().
  double board_speed_mps_ = 0.0;  // Of the board's centre along it.
  std::vector<Observation> observations_;
  std::optional<Pose<EndEffector, Board>> eMo_;
  double eMo_sigma_m_ = 0.0;
  Instant last_look_on_{};
  std::optional<double> eta_s_;
  std::optional<Goal> goal_;  ///< Of the drive under way, for those who watch.
  std::string stage_;         ///< Stage and eye of the last report.
};

/// How the cell's observations are solved.
SolveOptions solveOptions(const Run& run);

/// The eye that the arm found, and stands before; or why there is none.
struct Found {
  Eye* eye = nullptr;
  std::string problem;
};
/// Turns the raised arm as the cell file says (arm: search), while all eyes look on, then goes back to where the
/// first one of them saw the board nearest to its image centre.
Found search(Run& run);

/// Probing motions from the present pose until it is known where the eye stands and the board sits; a sentence
/// if that cannot be.
std::optional<std::string> bootstrap(Run& run, Eye& eye);

/// Brings the board before an eye for its turn; a sentence if that cannot be.
std::optional<std::string> handOver(Run& run, Eye& eye);

/// The largest roll, pitch and yaw at which the board is still detected, in the middle of the image; servos on
/// `color` and records for both streams of its camera at once. Every successful step is an observation too.
void findTiltLimits(Run& run, Eye& color);

/// Drives the board to what the eye has not seen yet; counts against the camera's budget of views.
/// Returns the views taken.
int cover(Run& run, Eye& eye, int max_views);

/// Drives the board, before whichever eye, to the views that tell most of all of them, until the goals of the cell
/// file are met; then to what the eyes' floors of coverage lack. Why it ended before the goals were met; nothing if they
/// were, as far as is known before the final solve.
std::optional<std::string> inform(Run& run);

/// Views facing the camera at two distances, without tilt, for the eye-to-hand estimate.
void revisit(Run& run, Eye& eye);
/// A few views for the held-out error.
void takeCheckViews(Run& run, Eye& eye);

}  // namespace servocal::procedure
