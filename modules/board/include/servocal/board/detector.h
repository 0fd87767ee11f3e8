// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "servocal/core/board_spec.h"
#include "servocal/core/observation.h"

namespace servocal::board {

/// Finds a checkerboard in gray images; remembers the last one and looks there first.
///
/// A board is reported only whole, with every inner corner, and, if it has a hollow corner, only ever
/// with the right orientation or with `orientation_known` false. Never guesses.
class Detector {
 public:
  /// @throws std::invalid_argument if the board is smaller than 3 x 3 squares.
  explicit Detector(const BoardSpec& board);
  ~Detector();
  Detector(Detector&&) noexcept;

  /// `image`: CV_8UC1 or CV_8UC3 (BGR). Nothing if no whole board is seen.
  std::optional<BoardDetection> detect(const cv::Mat& image);
  /// Looks near the last detection only: a few ms, for every cycle of a servo loop. Nothing if it is
  /// not there; detect() falls back to the whole image.
  std::optional<BoardDetection> track(const cv::Mat& image);
  /// Forgets the last detection.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::board
