// SPDX-License-Identifier: GPL-3.0-or-later
// The finders that detection is measured against.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <map>
#include <memory>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

extern "C" {
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
}

namespace servocal::peers {

using Points = std::vector<Eigen::Vector2d>;

/// findChessboardCorners, then cornerSubPix with the window that served best on such boards: 0.4 of the
/// smallest spacing.
inline std::optional<Points> classic(const cv::Mat& gray, const cv::Size& size) {
  std::vector<cv::Point2f> corners;
  if (!cv::findChessboardCorners(gray, size, corners)) return std::nullopt;
  double spacing = 1e9;
  for (int k = 0; k < size.area(); ++k) {
    if (k % size.width > 0) spacing = std::min(spacing, cv::norm(corners[k] - corners[k - 1]));
    if (k >= size.width) spacing = std::min(spacing, cv::norm(corners[k] - corners[k - size.width]));
  }
  const int half = std::max(1, static_cast<int>(0.4 * spacing));
  cv::cornerSubPix(gray, corners, {half, half}, {-1, -1},
                   {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01});
  Points result;
  for (const cv::Point2f& p : corners) result.emplace_back(p.x, p.y);
  return result;
}

inline std::optional<Points> sectorBased(const cv::Mat& gray, const cv::Size& size) {
  std::vector<cv::Point2f> corners;
  if (!cv::findChessboardCornersSB(gray, size, corners)) return std::nullopt;
  Points result;
  for (const cv::Point2f& p : corners) result.emplace_back(p.x, p.y);
  return result;
}

/// libapriltag at full resolution. Corners clockwise from the upper left, by code; pixel centres at whole
/// numbers.
class AprilTag {
 public:
  AprilTag()
      : family_(tag36h11_create(), tag36h11_destroy),
        detector_(apriltag_detector_create(), apriltag_detector_destroy) {
    apriltag_detector_add_family_bits(detector_.get(), family_.get(), 1);
    detector_->nthreads = 1;
    detector_->quad_decimate = 1;
    detector_->refine_edges = true;
    detector_->qtp.min_white_black_diff = 20;  // The default of 5 costs ten times the time, on noise.
  }

  std::map<int, Points> read(const cv::Mat& gray) {
    image_u8_t image = {gray.cols, gray.rows, static_cast<int32_t>(gray.step), gray.data};
    const std::unique_ptr<zarray_t, decltype(&apriltag_detections_destroy)> found(
        apriltag_detector_detect(detector_.get(), &image), apriltag_detections_destroy);
    std::map<int, Points> tags;
    for (int k = 0; k < zarray_size(found.get()); ++k) {
      const apriltag_detection_t* tag = nullptr;
      zarray_get(found.get(), k, &tag);
      Points corners;
      for (int corner = 0; corner < 4; ++corner)
        corners.emplace_back(tag->p[3 - corner][0] - 0.5, tag->p[3 - corner][1] - 0.5);
      tags[tag->id] = corners;
    }
    return tags;
  }

 private:
  std::unique_ptr<apriltag_family_t, decltype(&tag36h11_destroy)> family_;  // Outlives the detector.
  std::unique_ptr<apriltag_detector_t, decltype(&apriltag_detector_destroy)> detector_;
};

}  // namespace servocal::peers
