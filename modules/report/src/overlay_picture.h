// SPDX-License-Identifier: GPL-3.0-or-later
// Color, infrared and depth of one moment as one picture.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>

#include "servocal/core/camera_model.h"
#include "servocal/core/depth_model.h"
#include "servocal/core/pose.h"

namespace servocal::report {

struct OverlayImages {
  cv::Mat color;     ///< CV_8UC1.
  cv::Mat infrared;  ///< CV_8UC1.
  cv::Mat depth;     ///< CV_16UC1, raw, mm; the infrared camera's pixels.
  cv::Rect board;    ///< Where the color image shows the board, whose black and white are made alike; empty:
                     ///< everywhere.
};

/// What takes a depth pixel into the color image.
struct Registration {
  CameraModel color;
  DepthModel depth;  ///< Its camera is the infrared one.
  Pose<Color, Infrared> cMi;
};

/// An image of a session as CV_8UC1, stretched to what occurs in it; empty if there is none.
cv::Mat readGray(const std::filesystem::path& folder, const std::string& file);
/// A depth image of a session, CV_16UC1; empty if there is none.
cv::Mat readCounts(const std::filesystem::path& folder, const std::string& file);

/// True if there are all images, of the cameras' sizes.
bool fits(const OverlayImages& images, const Registration& registration);

/// The color image, at most 640 px wide, CV_8UC3 (BGR): blue and green show what color sees, red what
/// infrared sees of the same place by its depth. Where both agree the picture is gray, elsewhere it has red
/// and cyan fringes. Yellow: jumps of the depth. Where there is no depth the color image is darkened.
cv::Mat drawOverlay(const OverlayImages& images, const Registration& registration);

std::string jpegDataUrl(const cv::Mat& picture);

}  // namespace servocal::report
