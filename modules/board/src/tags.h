// SPDX-License-Identifier: GPL-3.0-or-later
// Square tags with a black border: reading them, and what is known of their pictures.
#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace servocal::board {

/// Corners of a tag's black border, clockwise from the upper left of the upright tag, px. A pixel's centre
/// has whole coordinates.
using TagCorners = std::array<Eigen::Vector2d, 4>;

double shortestSide(const TagCorners& corners);

struct SeenTag {
  int code = 0;
  TagCorners corners;
};

/// Finds and reads the tags of one family. Not to be shared between threads.
class TagReader {
 public:
  virtual ~TagReader() = default;
  /// Every tag of the family in `gray` (CV_8UC1). Squares are looked for in the image made smaller by
  /// `shrink` (1: as it is).
  virtual std::vector<SeenTag> read(const cv::Mat& gray, int shrink) = 0;
  /// How far the corners read may be from the tag's, px.
  virtual double cornerErrorPx(int shrink) const = 0;
};

/// 36h11 through libapriltag, with a black border of one or two cells.
std::unique_ptr<TagReader> makeAprilTagReader(int border_cells);
/// One of OpenCV's predefined dictionaries, "aruco_6x6_250".
std::unique_ptr<TagReader> makeArucoReader(const std::string& dictionary, int border_cells);

}  // namespace servocal::board
