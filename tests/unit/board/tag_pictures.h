// SPDX-License-Identifier: GPL-3.0-or-later
// Pictures of tags. The codes are OpenCV's, not the library's under test.
#pragma once

#include <map>
#include <opencv2/aruco.hpp>

#include "pictures.h"

namespace servocal::test {

/// A tag as printed: one pixel per cell, upright, black border included.
inline cv::Mat tagImage(const TagGrid& grid, int code) {
  if (!grid.isAprilTag()) throw std::invalid_argument("tagImage: no such family here");
  const int dictionary = cv::aruco::DICT_APRILTAG_36h11, bits = 6;
  cv::Mat image;
  cv::aruco::drawMarker(cv::aruco::getPredefinedDictionary(dictionary), code, bits + 2 * grid.border_bits,
                        image, grid.border_bits);
  // OpenCV has AprilTag's tags upside down.
  if (grid.isAprilTag()) cv::rotate(image, image, cv::ROTATE_180);
  return image;
}

struct TagPictureOptions : PictureOptions {
  bool kalibr_squares = false;  ///< Black squares between the tags' corners, as Kalibr prints them.
  std::map<int, int> codes;     ///< Other codes than the board's, by place.
};

/// Renders a board of tags; PictureOptions::square_px is the side of a tag.
inline Picture renderTags(const BoardSpec& board, const TagPictureOptions& options) {
  const TagGrid& grid = *board.as<TagGrid>();
  std::vector<cv::Mat> images;
  for (int place = 0; place < grid.tags_x * grid.tags_y; ++place) {
    const auto other = options.codes.find(place);
    images.push_back(tagImage(grid, other == options.codes.end() ? grid.code(place) : other->second));
  }
  const double gap = grid.tag_gap_m / grid.tag_size_m, pitch = 1 + gap;
  return renderPainted(board, options, [&](double x, double y) {
    const int column = static_cast<int>(std::floor((x + gap) / pitch)),
              row = static_cast<int>(std::floor((y + gap) / pitch));
    const double in_x = x - column * pitch, in_y = y - row * pitch;  // Negative in the gap before a tag.
    if (column < 0 || row < 0 || column > grid.tags_x || row > grid.tags_y) return 1.0;
    if (in_x < 0 || in_y < 0 || column == grid.tags_x || row == grid.tags_y)
      return options.kalibr_squares && in_x < 0 && in_y < 0 ? 0.0 : 1.0;
    const cv::Mat& image = images[row * grid.tags_x + column];
    const int cells = image.cols;
    return image.at<uchar>(std::min(cells - 1, static_cast<int>(in_y * cells)),
                           std::min(cells - 1, static_cast<int>(in_x * cells))) /
           255.0;
  });
}

}  // namespace servocal::test
