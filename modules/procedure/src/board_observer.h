// SPDX-License-Identifier: GPL-3.0-or-later
// Turns the frames of one stream into sights of the board, for the servo loop and for observations.
#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <utility>

#include "servocal/board/detector.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/sensor/rgbd_camera.h"
#include "servocal/servo/drive.h"

namespace servocal::procedure {

/// One frame and what was found in it.
struct SeenFrame {
  sensor::Frame frame;
  std::optional<BoardDetection> detection;
};

class BoardObserver final : public servo::Observer {
 public:
  BoardObserver(const BoardSpec& board, sensor::RgbdCamera& camera, Stream stream, const CameraModel& model);

  servo::Look look(Instant deadline) override;
  /// The next frame with its detection; nothing if no frame came until `deadline`.
  std::optional<SeenFrame> see(Instant deadline);
  /// True if a detection can steer the arm and be an observation: its orientation is known, and of a board
  /// that may be seen in part, at least half is.
  bool isUsable(const BoardDetection& detection) const;
  /// Board pose of a detection made at `stamp`, in the current camera model; the planar solution that fits
  /// better, or of two that fit alike the one the robot predicts, or without a prediction the one nearer to
  /// the last pose.
  std::optional<Pose<Color, Board>> poseOf(const BoardDetection& detection, Instant stamp);

  /// Where the robot says the board is in the camera, once the hand-eye is known.
  using Prediction = std::function<std::optional<Pose<Color, Board>>(Instant stamp)>;
  void setPrediction(Prediction prediction) { predict_ = std::move(prediction); }

  /// What is wrong with the exposure of most frames in which no board was found; nothing if the board was
  /// found in most, or if nothing is wrong with it.
  std::optional<std::string> lightTrouble() const;

  /// Called with every frame that is looked at.
  using Watcher = std::function<void(const SeenFrame&)>;
  void setWatcher(Watcher watcher) { watcher_ = std::move(watcher); }

  void setModel(const CameraModel& model) { model_ = model; }
  const CameraModel& model() const { return model_; }

 private:
  BoardSpec board_;
  sensor::RgbdCamera& camera_;
  Stream stream_;
  CameraModel model_;
  board::Detector detector_;
  Prediction predict_;
  Watcher watcher_;
  std::optional<Pose<Color, Board>> last_pose_;
  int looks_ = 0, badly_exposed_ = 0;
  std::string light_trouble_;  ///< Of the last one.
};

}  // namespace servocal::procedure
