// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "ink_map.h"
#include "lens.h"
#include "pixel_kernels.h"
#include "servocal/core/board_spec.h"

namespace servocal::sim {

/// Where a camera's light comes from and how it falls off.
struct Light {
  Eigen::Vector3d towards_c;    ///< Unit vector to the light, camera frame.
  Eigen::Vector2d fall_per_px;  ///< Relative fall of the light, per pixel along u and v ...
  double fall_at_origin = 0.0;  ///< ... and at pixel (0, 0).
  double specular = 0.0;        ///< Strength of the board's highlight; 1 adds full scale.

  double at(double u, double v) const {
    return 1.0 - fall_at_origin - fall_per_px.x() * u - fall_per_px.y() * v;
  }
};

/// Columns [begin, end) of one image row.
struct Span {
  int begin = 1 << 30;
  int end = 0;
  bool empty() const { return begin >= end; }
};

/// The board as one camera sees it, before it is laid over the background.
class BoardLayer {
 public:
  BoardLayer(const BoardSpec& board, const Lens& lens, const RayTable& rays, const Light& light);

  /// Draws the average over the poses `cMo`, blurred by a Gaussian. Seen from behind, the board is a
  /// dark plate; a board that reaches behind the camera is not drawn.
  void draw(const std::vector<Eigen::Isometry3d>& poses, double blur_sigma_px);

  /// What was drawn: the region touched and, with box().tl() as origin, gray times coverage and coverage.
  const cv::Rect& box() const { return box_; }
  const cv::Mat& color() const { return color_; }
  const cv::Mat& alpha() const { return alpha_; }
  /// Touched columns of an image row of box().
  Span span(int row) const { return padded_[row]; }

 private:
  void outline(const Eigen::Isometry3d& cMo, std::vector<Span>& spans) const;
  void pad(int by);
  void shade(const Eigen::Isometry3d& cMo, const cv::Rect& box);
  BoardPattern squaresSeen(const Eigen::Isometry3d& cMo) const;
  InkPattern inkSeen(const Eigen::Isometry3d& cMo) const;
  /// Takes a ray (x, y, 1) to pattern coordinates that start at `origin_o`.
  void fromRay(const Eigen::Isometry3d& cMo, const Eigen::Vector3d& origin_o, float (&from_ray)[9]) const;
  void add(const Eigen::Isometry3d& cMo, const std::vector<Span>& spans, float weight);

  BoardSpec board_;
  std::optional<InkMap> ink_;  ///< Of any print but a checkerboard's, which has a closed form.
  double unit_m_;              ///< Of the pattern's coordinates.
  Lens lens_;
  const RayTable& rays_;
  Light light_;

  cv::Rect box_;
  cv::Mat color_;
  cv::Mat alpha_;
  std::vector<Span> spans_;   ///< By image row, of all poses together.
  std::vector<Span> padded_;  ///< The same with room for the blur.
  std::vector<std::vector<Span>> pose_spans_;
  cv::Mat nodes_;             ///< CV_32FC4 every few pixels of the box: footprints, light, highlight.
};

}  // namespace servocal::sim
