// SPDX-License-Identifier: GPL-3.0-or-later
// Pictures of tags. The codes are OpenCV's, not the library's under test.
#pragma once

#include <map>
#include <opencv2/aruco.hpp>

#include "painted_picture.h"
#include "pictures.h"

namespace servocal::test {

/// A tag as printed: one pixel per cell, upright, black border included. Families: 36h11, and ArUco's
/// 5x5_250.
inline cv::Mat tagImage(const std::string& family, int code, int border_bits) {
  const bool april = family == "apriltag_36h11";
  if (!april && family != "aruco_5x5_250") throw std::invalid_argument("tagImage: no such family here");
  const int dictionary = april ? cv::aruco::DICT_APRILTAG_36h11 : cv::aruco::DICT_5X5_250,
            bits = april ? 6 : 5;
  cv::Mat image;
  cv::aruco::drawMarker(cv::aruco::getPredefinedDictionary(dictionary), code, bits + 2 * border_bits, image,
                        border_bits);
  if (april) cv::rotate(image, image, cv::ROTATE_180);  // OpenCV has AprilTag's tags upside down.
  return image;
}

/// Reflectance inside a tag, x and y from 0 to 1.
inline double tagReflectance(const cv::Mat& image, double x, double y) {
  const int cells = image.cols;
  return image.at<uchar>(std::min(cells - 1, static_cast<int>(y * cells)),
                         std::min(cells - 1, static_cast<int>(x * cells))) /
         255.0;
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
    images.push_back(tagImage(grid.family, other == options.codes.end() ? grid.code(place) : other->second,
                              grid.border_bits));
  }
  const double gap = grid.tag_gap_m / grid.tag_size_m, pitch = 1 + gap;
  return renderPainted(board, options, [&](double x, double y) {
    const int column = static_cast<int>(std::floor((x + gap) / pitch)),
              row = static_cast<int>(std::floor((y + gap) / pitch));
    const double in_x = x - column * pitch, in_y = y - row * pitch;  // Negative in the gap before a tag.
    if (column < 0 || row < 0 || column > grid.tags_x || row > grid.tags_y) return 1.0;
    if (in_x < 0 || in_y < 0 || column == grid.tags_x || row == grid.tags_y)
      return options.kalibr_squares && in_x < 0 && in_y < 0 ? 0.0 : 1.0;
    return tagReflectance(images[row * grid.tags_x + column], in_x, in_y);
  });
}

/// Renders a ChArUco board; PictureOptions::square_px is the side of a square.
inline Picture renderCharuco(const BoardSpec& board, const PictureOptions& options) {
  const Charuco& p = *board.as<Charuco>();
  std::vector<cv::Mat> images(p.squares_x * p.squares_y);
  int code = 0;
  for (int square = 0; square < p.squares_x * p.squares_y; ++square)
    if (((square % p.squares_x + square / p.squares_x) % 2 == 0) == p.first_square_white)
      images[square] = tagImage(p.dictionary, code++, 1);
  const double side = p.marker_size_m / p.square_size_m, inset = 0.5 * (1 - side);
  return renderPainted(board, options, [=](double x, double y) {
    if (x < 0 || y < 0 || x >= p.squares_x || y >= p.squares_y) return 1.0;
    const int column = static_cast<int>(x), row = static_cast<int>(y);
    const cv::Mat& image = images[row * p.squares_x + column];
    if (image.empty()) return 0.0;
    const double in_x = (x - column - inset) / side, in_y = (y - row - inset) / side;
    if (in_x < 0 || in_y < 0 || in_x >= 1 || in_y >= 1) return 1.0;
    return tagReflectance(image, in_x, in_y);
  });
}

/// Renders a grid of circles; PictureOptions::square_px is their distance within a row.
inline Picture renderCircles(const BoardSpec& board, const PictureOptions& options) {
  const CircleGrid& p = *board.as<CircleGrid>();
  const std::vector<Eigen::Vector3d> centres = board.corners();
  const Eigen::Vector2d origin = board.patternOutline().front().head<2>();
  return renderPainted(board, options, [&](double x, double y) {
    const Eigen::Vector2d at = origin + p.spacing_m * Eigen::Vector2d(x, y);
    for (std::size_t id = 0; id < centres.size(); ++id) {
      const double radius = 0.5 * p.diameter_m * (id == 0 ? p.bigger_corner_ratio : 1.0);
      if ((at - centres[id].head<2>()).squaredNorm() < radius * radius) return 0.0;
    }
    return 1.0;
  });
}

}  // namespace servocal::test
