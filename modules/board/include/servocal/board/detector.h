// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "servocal/core/board_spec.h"
#include "servocal/core/observation.h"

namespace servocal::board {

/// Finds a board of any kind in images; remembers the last one and looks there first.
///
/// A checkerboard or circle grid is reported only whole, with every corner, and, if it has a mark, only
/// ever with the right orientation or with `orientation_known` false. Boards of coded tags and ChArUco
/// boards are reported with the corners that are seen. Never guesses.
class Detector {
 public:
  /// @throws std::invalid_argument if the board cannot be detected: fewer than 3 x 3 squares, a square grid of
  ///   circles without a mark, a tag family that is not known.
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
