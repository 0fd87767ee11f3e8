// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "ink_map.h"
#include "lens.h"
#include "pixel_kernels.h"
#include "servocal/core/board_spec.h"

namespace servocal::sim {

/// A camera's own light, at the camera: it falls with distance squared and towards the image's corners.
struct ActiveLight {
  double range_m = 0.7;  ///< Where its factor on the gray is 1 with the gain at 1.
  Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();
  double fall_per_px2 = 0.0;  ///< Relative fall, by the squared distance from the image's centre.

  double at(double u, double v) const {
    return 1.0 - fall_per_px2 * (Eigen::Vector2d(u, v) - centre_px).squaredNorm();
  }
  /// At a distance, with the board at `board_m`, for which the camera's gain makes up in part.
  double at(double u, double v, double distance_m, double board_m) const {
    const double gain = std::clamp(board_m / range_m, 0.5, 2.5);
    return at(u, v) * gain * std::min(3.0, range_m * range_m / (distance_m * distance_m));
  }
};

/// Where a camera's light comes from and how it falls off.
struct Light {
  Eigen::Vector3d towards_c;          ///< Unit vector to the light, camera frame.
  Eigen::Vector2d fall_per_px;        ///< Relative fall of the light, per pixel along u and v ...
  double fall_at_origin = 0.0;        ///< ... and at pixel (0, 0).
  double specular = 0.0;              ///< Strength of the board's highlight; 1 adds full scale.
  double diffuse = 0.3;               ///< Share of the light that depends on the board's normal.
  std::optional<ActiveLight> active;  ///< Instead of the fall across the image.

  double at(double u, double v) const {
    return 1.0 - fall_at_origin - fall_per_px.x() * u - fall_per_px.y() * v;
  }
  /// Factor on the gray of what is behind the board.
  double onWall(double u, double v) const { return active ? kActiveOnWall * active->at(u, v) : at(u, v); }
  static constexpr double kActiveOnWall = 0.45;  ///< It is farther off.
};

/// Grays in full light.
struct Tones {
  double white = 215.0;
  double black = 26.0;
  double back = 40.0;  ///< Of the board seen from behind.
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
  BoardLayer(const BoardSpec& board, const Lens& lens, const RayTable& rays, const Light& light,
             const Tones& tones = {});

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
  Tones tones_;

  cv::Rect box_;
  cv::Mat color_;
  cv::Mat alpha_;
  std::vector<Span> spans_;   ///< By image row, of all poses together.
  std::vector<Span> padded_;  ///< The same with room for the blur.
  std::vector<std::vector<Span>> pose_spans_;
  cv::Mat nodes_;  ///< CV_32FC4 every few pixels of the box: footprints, light, highlight.
};

}  // namespace servocal::sim
