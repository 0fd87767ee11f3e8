// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/pose.h"

namespace servocal::plan {

/// The board was held like this before one stream, and found or not.
struct Trial {
  Pose<Color, Board> cMo;
  bool detected = false;
};

/// How likely one stream's detector finds the board where it is shown whole: a logistic function of how large its
/// smallest distance of points is in the image and of how obliquely it is looked at.
class Detectability {
 public:
  /// What is supposed before anything was tried: 0.95 for 12 px and 45 degrees, 0.5 at 60 degrees.
  Detectability(const BoardSpec& board, const CameraModel& camera);
  /// The maximum a posteriori of what was supposed and the trials.
  void learn(const std::vector<Trial>& trials);

  [[nodiscard]] double probability(const Pose<Color, Board>& cMo) const;

 private:
  Eigen::Vector3d features(const Pose<Color, Board>& cMo) const;

  CameraModel camera_;
  double spacing_m_ = 0.0;
  Eigen::Vector3d weights_;  // of one, log of size, radians of obliquity
};

}  // namespace servocal::plan
