// SPDX-License-Identifier: GPL-3.0-or-later
// One stream of one camera: what it shows, what is believed of it, what it has seen so far.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "board_observer.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/result.h"
#include "servocal/coverage/coverage.h"

namespace servocal::procedure {

/// Where the board was seen nearest to the image centre by an eye that was not asked to look for it.
struct Sighting {
  RobotState robot;
  double from_centre_px = 0.0;
};

/// The color or the infrared stream of a camera. Poses of its board and of itself are written as those of a
/// color camera: for the control law and the solvers there is no difference.
class Eye {
 public:
  Eye(const CellConfig& cell, const CameraConfig& camera, sensor::RgbdCamera& device, Stream stream);

  const std::string& camera() const { return camera_.name; }
  Stream stream() const { return stream_; }
  std::string name() const { return camera_.name + " " + toString(stream_); }
  const CameraConfig& config() const { return camera_; }
  sensor::RgbdCamera& device() { return device_; }
  double rateHz() const;
  /// True if the camera's other stream stops while this one is read.
  bool excludesOthers() const { return camera_.infrared && camera_.infrared->excludes_color; }
  bool hasDepth() const { return stream_ == Stream::kInfrared && camera_.infrared->depth.has_value(); }

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

  /// Counts a settled view.
  void count(const StreamObservation& view);
  /// Keeps the sighting nearest to the image centre.
  void note(const RobotState& robot, const BoardDetection& detection);

  /// How measuring the board's depth went at a stop: empty, or what was wrong.
  void noteDepth(const std::string& reason);
  /// What was wrong with the depth at most stops; nothing if it was well at most of them.
  std::optional<std::string> depthTrouble() const;

  coverage::Coverage coverage;
  std::vector<TiltLimit> tilt_limits;
  std::optional<Sighting> sighting;
  int views = 0;  ///< Settled ones.
  Instant last_shown{};  ///< To those who watch.

 private:
  bool isShown(const Pose<Color, Board>& cMo, double margin_px, double least_cosine) const;

  CameraConfig camera_;
  BoardSpec board_;
  sensor::RgbdCamera& device_;
  Stream stream_;
  BoardObserver observer_;
  std::optional<Pose<Base, Color>> bMc_;
  std::optional<HandEyeSolution> hand_eye_;
  int depths_ = 0, depth_failures_ = 0;
  std::string depth_reason_;  ///< Of the last failure.
};

}  // namespace servocal::procedure
