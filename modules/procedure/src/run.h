// SPDX-License-Identifier: GPL-3.0-or-later
// What the stages of a run share: the devices, what was observed, and what is believed so far.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "board_observer.h"
#include "servocal/calib/reprojection.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/servo/drive.h"

namespace servocal::procedure {

class Run {
 public:
  Run(const CellConfig& cell, const Devices& devices, session::Session& session, const EventSink& on_event);

  Run(const Run&) = delete;  // The observer asks this very object where the board is.
  Run& operator=(const Run&) = delete;

  /// Takes an observation: waits until the arm stands still, averages a few frames taken since, stores it
  /// and updates the belief. Nothing if the board is not seen in most of them.
  std::optional<Observation> observe(const std::string& stage);

  /// A drive, and what was observed where it ended.
  struct Visit {
    servo::DriveOutcome drive;
    std::optional<Observation> observation;
  };
  /// Drives the board to a view, observes there if it arrived, and stores the attempt.
  Visit visit(const std::string& stage, const Pose<Color, Board>& cdMo, servo::DriveOptions options = {});
  /// Moves the flange straight to a pose, on robot states alone.
  /// @throws Error (kSafetyStop) if a limit is in the way.
  void moveTo(const Pose<Base, EndEffector>& bMe);

  /// Reports progress.
  void report(const std::string& stage, int done, int planned, const std::string& message = {});
  void setEta(std::optional<double> eta_s) { eta_s_ = eta_s; }

  const CellConfig& cell() const { return cell_; }
  const Devices& devices() const { return devices_; }
  robot::Guard& guard() { return devices_.guard; }
  Clock& clock() { return devices_.clock; }
  BoardObserver& observer() { return observer_; }
  const std::vector<Observation>& observations() const { return observations_; }
  const std::string& camera() const { return cell_.cameras.front().name; }

  /// The accumulated eye-to-hand estimate; nothing before the bootstrap.
  const std::optional<HandEyeSolution>& handEye() const { return hand_eye_; }
  Pose<Base, Color> bMc() const { return Pose<Base, Color>(hand_eye_->camera_pose); }
  Pose<EndEffector, Board> eMo() const { return Pose<EndEffector, Board>(hand_eye_->board_pose); }
  /// Where the flange must be for the board to be seen like this.
  Pose<Base, EndEffector> flangeFor(const Pose<Color, Board>& cMo) const {
    return bMc() * cMo * eMo().inverse();
  }

  /// Re-estimates the intrinsics (with the data sheet as a prior) and the hand-eye from everything seen.
  /// False if the views do not determine the hand-eye yet; then why() says what is missing.
  bool updateBelief();
  const std::string& why() const { return why_; }

 private:
  void throwIfStopped() const;

  const CellConfig& cell_;
  Devices devices_;
  session::Session& session_;
  const EventSink& on_event_;
  BoardObserver observer_;
  std::vector<Observation> observations_;
  std::optional<HandEyeSolution> hand_eye_;
  std::string why_;
  std::optional<double> eta_s_;
};

/// Probing motions from the start pose until the hand-eye is known; a sentence if it cannot be.
std::optional<std::string> bootstrap(Run& run);

/// The largest roll, pitch and yaw at which the board is still detected, in the middle of the image.
/// Every successful step is an observation too.
std::vector<TiltLimit> findTiltLimits(Run& run);

struct CoverResult {
  CoverageSummary summary;
  std::vector<std::string> missing;  ///< What is not covered, a sentence each.
  int views = 0;
};
/// Drives the board to what the camera has not seen yet.
CoverResult cover(Run& run, const std::vector<TiltLimit>& tilt_limits);

}  // namespace servocal::procedure
