// SPDX-License-Identifier: GPL-3.0-or-later
// What every kind of board brings: a way to find it. One file per kind.
#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "servocal/core/board_spec.h"
#include "servocal/core/observation.h"

namespace servocal::board {

/// Detector's work for one kind of board; images are CV_8UC1 or CV_8UC3 and not empty.
class Finder {
 public:
  virtual ~Finder() = default;
  virtual std::optional<BoardDetection> detect(const cv::Mat& image) = 0;
  virtual std::optional<BoardDetection> track(const cv::Mat& image) = 0;
  virtual void reset() = 0;
};

/// @throws std::invalid_argument if the board is not of that kind or cannot be detected.
std::unique_ptr<Finder> makeCheckerboardFinder(const BoardSpec& board);
std::unique_ptr<Finder> makeTagGridFinder(const BoardSpec& board);
std::unique_ptr<Finder> makeCharucoFinder(const BoardSpec& board);
std::unique_ptr<Finder> makeCircleFinder(const BoardSpec& board);

/// CV_8UC1; the image itself if it is gray already.
cv::Mat toGray(const cv::Mat& image);

}  // namespace servocal::board
