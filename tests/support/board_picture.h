// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "servocal/core/board_spec.h"

namespace servocal::test {

/// How a board is seen in a rendered picture.
struct PictureOptions {
  int width_px = 640;
  int height_px = 480;
  double focal_px = 600.0;
  double k1 = 0.0;              ///< Radial distortion.
  Eigen::Vector2d centre_px = {320, 240};  ///< Where the board's centre is seen (before distortion).
  double square_px = 30.0;      ///< Size of a square at the board's centre, seen from the front.
  double tilt_rad = 0.0;        ///< Between the board's normal and the line of sight.
  double tilt_axis_rad = 0.0;   ///< Direction of the tilt axis in the image.
  double roll_rad = 0.0;        ///< Board about its own normal.
  double blur_px = 0.7;         ///< Standard deviation of the point spread.
  double motion_px = 0.0;       ///< Length of the motion blur.
  double motion_rad = 0.0;
  double noise_gray = 2.0;
  double black = 30, white = 220;
  double light_gradient = 0.0;  ///< Relative change of light over the image's width and height.
  double highlight_gray = 0.0;  ///< Peak of a specular highlight on the board.
  bool clutter = true;
  bool board = true;            ///< False: the background alone.
  bool mirror = false;          ///< The board as seen in a mirror: left and right swapped.
  unsigned seed = 1;
  /// Opaque things in front of the board, in board coordinates (squares from the upper left), and their gray.
  struct Cover {
    double x0, y0, x1, y1, gray;
  };
  std::vector<Cover> covers;
};

struct Picture {
  cv::Mat gray;
  std::vector<Eigen::Vector2d> corners;  ///< True pixel of every inner corner, by id.
  std::vector<Eigen::Vector2d> outline;  ///< Of the plate, rim included.
};

namespace picture {

inline double uniform(std::mt19937& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

/// Reflectance (0 black, 1 white) of the printed board at a point in squares from its upper left.
inline double reflectance(const Checkerboard& board, double x, double y) {
  if (x < 0 || y < 0 || x >= board.squares_x || y >= board.squares_y) return 1;
  const int column = static_cast<int>(x), row = static_cast<int>(y);
  if ((column + row) % 2 == 1) return 1;
  if (board.hollow_corner && column == 0 && row == 0) {
    const double inset = 0.5 * (1 - board.hollow_inner_ratio);
    if (x > inset && x < 1 - inset && y > inset && y < 1 - inset) return 1;
  }
  return 0;
}

/// A cell full of things: boxes, lines, discs, lettering, a tiled patch.
inline cv::Mat clutter(const cv::Size& size, std::mt19937& random) {
  cv::Mat image(size, CV_8UC1, cv::Scalar(uniform(random, 60, 180)));
  const auto point = [&] {
    return cv::Point(static_cast<int>(uniform(random, -50, size.width + 50)),
                     static_cast<int>(uniform(random, -50, size.height + 50)));
  };
  const double scale = size.width / 640.0;
  for (int k = 0; k < 60; ++k) {
    const cv::Scalar gray(uniform(random, 10, 245));
    const cv::Point p = point();
    switch (static_cast<int>(uniform(random, 0, 6))) {
      case 0: {
        const cv::RotatedRect box(p, cv::Size2f(uniform(random, 10, 160) * scale, uniform(random, 10, 100) * scale),
                                  uniform(random, 0, 360));
        cv::Point2f vertices[4];
        box.points(vertices);
        std::vector<cv::Point> polygon(vertices, vertices + 4);
        cv::fillConvexPoly(image, polygon, gray, cv::LINE_AA);
        break;
      }
      case 1: cv::line(image, p, point(), gray, static_cast<int>(uniform(random, 1, 6)), cv::LINE_AA); break;
      case 2: cv::circle(image, p, static_cast<int>(uniform(random, 4, 50) * scale), gray, cv::FILLED, cv::LINE_AA); break;
      case 3: cv::putText(image, "UR5 30 mm", p, cv::FONT_HERSHEY_SIMPLEX, uniform(random, 0.4, 1.5), gray, 2, cv::LINE_AA); break;
      case 4: cv::circle(image, p, static_cast<int>(uniform(random, 4, 50) * scale), gray, 2, cv::LINE_AA); break;
      default: {
        // Perforated sheet: rows of dots.
        const int pitch = static_cast<int>(uniform(random, 6, 14));
        for (int y = 0; y < 6; ++y)
          for (int x = 0; x < 8; ++x) cv::circle(image, p + cv::Point(x * pitch, y * pitch), pitch / 3, gray, cv::FILLED, cv::LINE_AA);
      }
    }
  }
  return image;
}

}  // namespace picture

/// What PictureOptions::square_px is the size of, m: a square, a tag, the distance of two circles.
inline double unitOf(const BoardSpec& board) {
  if (const auto* tags = board.as<TagGrid>()) return tags->tag_size_m;
  if (const auto* circles = board.as<CircleGrid>()) return circles->spacing_m;
  return board.spacing();
}

/// Where points of the board plane are seen.
struct View {
  View(const BoardSpec& board, const PictureOptions& options)
      : cx(0.5 * (options.width_px - 1)),
        cy(0.5 * (options.height_px - 1)),
        focal(options.focal_px),
        k1(options.k1),
        mirror(options.mirror ? -1.0 : 1.0) {
    using Eigen::Vector3d;
    const Vector3d sight((options.centre_px.x() - cx) / focal, (options.centre_px.y() - cy) / focal, 1.0);
    const Vector3d axis(std::cos(options.tilt_axis_rad), std::sin(options.tilt_axis_rad), 0);
    rotation = (Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), sight) *
                Eigen::AngleAxisd(options.tilt_rad, axis) * Eigen::AngleAxisd(options.roll_rad, Vector3d::UnitZ()))
                   .toRotationMatrix();
    position = sight * (focal * unitOf(board) / options.square_px);
  }

  /// Pixel of a point (m) of the board plane, in the board frame.
  Eigen::Vector2d project(double x, double y) const {
    const Eigen::Vector3d p = rotation * Eigen::Vector3d(mirror * x, y, 0) + position;
    const Eigen::Vector2d n(p.x() / p.z(), p.y() / p.z());
    const Eigen::Vector2d d = n * (1 + k1 * n.squaredNorm());
    return Eigen::Vector2d(focal * d.x() + cx, focal * d.y() + cy);
  }

  double cx, cy, focal, k1, mirror;
  Eigen::Matrix3d rotation;
  Eigen::Vector3d position;
};

inline std::vector<Eigen::Vector2d> projectOutline(const BoardSpec& board, const PictureOptions& options) {
  const View view(board, options);
  std::vector<Eigen::Vector2d> outline;
  for (const Eigen::Vector3d& corner : board.outline()) outline.push_back(view.project(corner.x(), corner.y()));
  return outline;
}

/// Renders a plate by casting 32 rays per pixel (a Hammersley set: 32 different columns and rows, so that
/// even an edge along the pixels is placed to 1/64 px), then blur, light and noise. Shares no code with the
/// library beyond BoardSpec. `paint(x, y)`: reflectance (0 black, 1 white) at a point of the plate, from the
/// pattern's upper left, in the board's unit (see unitOf).
template <typename Paint>
Picture renderPainted(const BoardSpec& board, const PictureOptions& options, const Paint& paint) {
  using Eigen::Vector2d;
  using Eigen::Vector3d;
  std::mt19937 random(options.seed);
  const cv::Size size(options.width_px, options.height_px);
  cv::Mat image;
  if (options.clutter) picture::clutter(size, random).convertTo(image, CV_32F);
  else image = cv::Mat(size, CV_32FC1, cv::Scalar(128));

  const View view(board, options);
  const double cx = view.cx, cy = view.cy, mirror = view.mirror;
  const double unit = unitOf(board);
  const Vector2d origin = board.patternOutline().front().head<2>() / unit;
  const Vector2d plate = -board.outline().front().head<2>() / unit;  // Half of it.

  Picture result;
  for (const Vector3d& corner : board.corners()) result.corners.push_back(view.project(corner.x(), corner.y()));
  result.outline = projectOutline(board, options);

  if (options.board) {
    Vector2d low = result.outline[0], high = result.outline[0];
    for (const Vector2d& p : result.outline) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    const int x0 = std::clamp(static_cast<int>(low.x()) - 3, 0, options.width_px);
    const int x1 = std::clamp(static_cast<int>(high.x()) + 4, 0, options.width_px);
    const int y0 = std::clamp(static_cast<int>(low.y()) - 3, 0, options.height_px);
    const int y1 = std::clamp(static_cast<int>(high.y()) + 4, 0, options.height_px);
    const Vector2d highlight = view.project(-0.4 * origin.x() * unit, -0.1 * unit);
    // From normalized image coordinates to the board plane.
    Eigen::Matrix3d to_image;
    to_image.col(0) = view.rotation.col(0);
    to_image.col(1) = view.rotation.col(1);
    to_image.col(2) = view.position;
    const Eigen::Matrix3d to_board = to_image.inverse();
    constexpr int kRays = 32;
    Vector2d rays[kRays];
    for (int k = 0; k < kRays; ++k) {
      int reversed = 0;
      for (int bit = 0; bit < 5; ++bit) reversed |= ((k >> bit) & 1) << (4 - bit);
      rays[k] = Vector2d((k + 0.5) / kRays - 0.5, (reversed + 0.5) / kRays - 0.5);
    }
    for (int y = y0; y < y1; ++y) {
      float* row = image.ptr<float>(y);
      for (int x = x0; x < x1; ++x) {
        double sum = 0;
        for (int k = 0; k < kRays; ++k) {
          const Vector2d d((x + rays[k].x() - cx) / options.focal_px, (y + rays[k].y() - cy) / options.focal_px);
          Vector2d n = d;
          if (options.k1 != 0)
            for (int iteration = 0; iteration < 5; ++iteration) n = d / (1 + options.k1 * n.squaredNorm());
          const Vector3d h = to_board * n.homogeneous();
          const double px = mirror * h.x() / h.z() / unit, py = h.y() / h.z() / unit;
          const double bx = px - origin.x(), by = py - origin.y();
          double gray = row[x];
          if (h.z() > 0 && std::abs(px) <= plate.x() && std::abs(py) <= plate.y())
            gray = options.black + (options.white - options.black) * paint(bx, by);
          for (const auto& cover : options.covers)
            if (bx > cover.x0 && bx < cover.x1 && by > cover.y0 && by < cover.y1) gray = cover.gray;
          sum += gray;
        }
        double value = sum / kRays;
        if (options.highlight_gray > 0) {
          const double distance = (Vector2d(x, y) - highlight).squaredNorm() / std::pow(1.5 * options.square_px, 2);
          value += options.highlight_gray * std::exp(-0.5 * distance);
        }
        row[x] = static_cast<float>(value);
      }
    }
  }
  if (options.motion_px > 0) {
    const int half = static_cast<int>(std::ceil(0.5 * options.motion_px)) + 1;
    cv::Mat kernel = cv::Mat::zeros(2 * half + 1, 2 * half + 1, CV_32F);
    constexpr int kSteps = 41;
    for (int k = 0; k < kSteps; ++k) {
      const double t = options.motion_px * ((k + 0.5) / kSteps - 0.5);
      const double x = half + t * std::cos(options.motion_rad), y = half + t * std::sin(options.motion_rad);
      const int xi = static_cast<int>(x), yi = static_cast<int>(y);
      for (int b = 0; b < 2; ++b)
        for (int a = 0; a < 2; ++a)
          kernel.at<float>(yi + b, xi + a) += static_cast<float>((a ? x - xi : 1 - x + xi) * (b ? y - yi : 1 - y + yi) / kSteps);
    }
    cv::filter2D(image, image, CV_32F, kernel, cv::Point(-1, -1), 0, cv::BORDER_REPLICATE);
  }
  if (options.blur_px > 0) cv::GaussianBlur(image, image, cv::Size(), options.blur_px, options.blur_px, cv::BORDER_REPLICATE);
  std::normal_distribution<float> normal(0.0f, static_cast<float>(std::max(options.noise_gray, 1e-6)));
  result.gray.create(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const double light = 1 + options.light_gradient * ((x - cx) / size.width + 0.5 * (y - cy) / size.height);
      const float value = static_cast<float>(image.at<float>(y, x) * light) + (options.noise_gray > 0 ? normal(random) : 0.0f);
      result.gray.at<uchar>(y, x) = cv::saturate_cast<uchar>(value);
    }
  }
  return result;
}

/// A checkerboard.
inline Picture renderPicture(const BoardSpec& board, const PictureOptions& options) {
  const Checkerboard& squares = *board.as<Checkerboard>();
  return renderPainted(board, options, [&](double x, double y) { return picture::reflectance(squares, x, y); });
}

}  // namespace servocal::test
