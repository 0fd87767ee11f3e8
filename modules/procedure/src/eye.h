// SPDX-License-Identifier: GPL-3.0-or-later
// One stream of one camera: what it shows, what is believed of it, what it has seen so far.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "board_observer.h"
#include "servocal/calib/time_offset.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/result.h"
#include "servocal/coverage/coverage.h"
#include "servocal/plan/detectability.h"
#include "servocal/sensor/frame_gate.h"

namespace servocal::procedure {

/// Where the board was seen nearest to the image centre by an eye that was not asked to look for it.
struct Sighting {
  RobotState robot;
  double from_centre_px = 0.0;
};

/// The color or the infrared stream of a camera. Poses of its board and of itself are written as those of a
/// color camera that stands in the cell: for the control law and the solvers there is no difference. For cameras on
/// the flange bMc stands for eMc and eMo for bMo (core/mount.h).
class Eye {
 public:
  Eye(const CellConfig& cell, const CameraConfig& camera, sensor::GatedCamera& device, Stream stream);

  const std::string& camera() const { return camera_.name; }
  Stream stream() const { return stream_; }
  std::string name() const { return camera_.name + " " + toString(stream_); }
  const CameraConfig& config() const { return camera_; }
  sensor::GatedCamera& device() { return device_; }
  double rateHz() const;
  /// True if the camera's other stream stops while this one is read.
  bool excludesOthers() const { return camera_.infrared && camera_.infrared->excludes_color; }
  bool hasDepth() const { return stream_ == Stream::kInfrared && camera_.infrared->depth.has_value(); }
  DepthSensor depthSensor() const { return *camera_.infrared->depth; }  ///< If it has depth.

  BoardObserver& observer() { return observer_; }
  const CameraModel& model() const { return observer_.model(); }
  CameraModel nominal() const { return nominalModel(camera_, stream_); }

  /// Where this eye stands, roughly or well; nothing before it has seen the board on a known mount.
  const std::optional<Pose<Base, Color>>& bMc() const { return bMc_; }
  /// The accumulated estimate behind it; nothing while the views do not determine one.
  const std::optional<HandEyeSolution>& handEye() const { return hand_eye_; }
  void believe(const Pose<Base, Color>& bMc) { bMc_ = bMc; }
  void believe(HandEyeSolution solution);

  /// Where the board would be seen, if that is known.
  std::optional<Pose<Color, Board>> predict(const Pose<Base, EndEffector>& bMe,
                                            const std::optional<Pose<EndEffector, Board>>& eMo) const;
  /// False if the board is surely not in this eye's image, or turned away.
  bool mightSee(const Pose<Base, EndEffector>& bMe, const std::optional<Pose<EndEffector, Board>>& eMo) const;

  /// True if the whole board should be in this eye's image with room around it, turned towards it.
  bool shouldSee(const Pose<Base, EndEffector>& bMe, const std::optional<Pose<EndEffector, Board>>& eMo) const;

  /// True if a drive by this eye can start here: it should see the board, and the last drive did not lose it. What is
  /// known of the cell says what should be seen, and may be wrong early on.
  bool canStart(const Pose<Base, EndEffector>& bMe, const std::optional<Pose<EndEffector, Board>>& eMo) const {
    return !lost && shouldSee(bMe, eMo);
  }
  bool lost = false;  ///< The last drive by this eye ended with the board out of its sight.

  /// A sight of the board while the arm moved.
  void noteMotion(const calib::TimedBoard& sight);
  /// From those sights and the arm's path, how late the stamps are; once two answers agree it is taken off.
  void compareClocks(const std::vector<RobotState>& path, const Pose<EndEffector, Board>& eMo);
  const std::optional<calib::TimeOffset>& timeOffset() const { return time_offset_; }
  /// Why no servo may go by this eye's images: they are too old when they come. Nothing if they are not.
  std::optional<std::string> tooLate() const;

  /// Why this eye hardly sees anything, as far as its frames tell: " (" half a sentence ")"; empty if they
  /// are fine.
  std::string whyBlind() const;

  /// Counts a settled view.
  void count(const StreamObservation& view);
  /// Keeps the sighting nearest to the image centre.
  void note(const RobotState& robot, const BoardDetection& detection);

  /// How measuring the board's depth went at a stop: empty, or what was wrong.
  void noteDepth(const std::string& reason);
  /// What was wrong with the depth at most stops; nothing if it was well at most of them.
  std::optional<std::string> depthTrouble() const;

  coverage::Coverage coverage;
  std::vector<plan::Trial> trials;  ///< How the board was held, whole in the image, and whether it was found.
  std::vector<TiltLimit> tilt_limits;
  std::optional<Sighting> sighting;
  int views = 0;         ///< Settled ones.
  Instant last_shown{};  ///< To those who watch.

 private:
  bool isShown(const Pose<Color, Board>& cMo, double margin_px, double least_cosine) const;

  CameraConfig camera_;
  BoardSpec board_;
  sensor::GatedCamera& device_;
  Stream stream_;
  BoardObserver observer_;
  std::optional<Pose<Base, Color>> bMc_;
  std::optional<HandEyeSolution> hand_eye_;
  std::vector<calib::TimedBoard> in_motion_;  ///< Until the stamps are compared.
  std::optional<calib::TimeOffset> first_offset_, time_offset_;
  int depths_ = 0, depth_failures_ = 0;
  std::string depth_reason_;  ///< Of the last failure.
};

}  // namespace servocal::procedure
