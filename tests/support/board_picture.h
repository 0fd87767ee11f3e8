// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>
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
  double k1 = 0.0;                         ///< Radial distortion.
  Eigen::Vector2d centre_px = {320, 240};  ///< Where the board's centre is seen (before distortion).
  double square_px = 30.0;                 ///< Size of a square at the board's centre, seen from the front.
  double tilt_rad = 0.0;                   ///< Between the board's normal and the line of sight.
  double tilt_axis_rad = 0.0;              ///< Direction of the tilt axis in the image.
  double roll_rad = 0.0;                   ///< Board about its own normal.
  double blur_px = 0.7;                    ///< Standard deviation of the point spread.
  double motion_px = 0.0;                  ///< Length of the motion blur.
  double motion_rad = 0.0;
  double noise_gray = 2.0;
  double black = 30, white = 220;
  double light_gradient = 0.0;  ///< Relative change of light over the image's width and height.
  double highlight_gray = 0.0;  ///< Peak of a specular highlight on the board.
  bool clutter = true;
  bool board = true;    ///< False: the background alone.
  bool mirror = false;  ///< The board as seen in a mirror: left and right swapped.
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

/// A flat picture made of rectangles: gray values between vertical and horizontal lines, in squares of the
/// board from its upper left. Outside the lines, and where the value is negative, there is nothing.
struct Print {
  std::vector<double> x, y;  ///< Positions of the lines, ascending.
  std::vector<double> gray;  ///< Row by row, (x.size() - 1) * (y.size() - 1) values.

  Print(std::vector<double> lines_x, std::vector<double> lines_y) : x(sorted(lines_x)), y(sorted(lines_y)) {
    gray.assign((x.size() - 1) * (y.size() - 1), -1.0);
  }

  /// Paints what lies inside a rectangle whose sides are among the lines.
  void paint(double x0, double y0, double x1, double y1, double value) {
    for (std::size_t row = 0; row + 1 < y.size(); ++row)
      for (std::size_t column = 0; column + 1 < x.size(); ++column)
        if (x[column] >= x0 && x[column + 1] <= x1 && y[row] >= y0 && y[row + 1] <= y1)
          gray[row * (x.size() - 1) + column] = value;
  }

  /// Number of lines at or before a place; `nearby` is that of a place not far away.
  static int passed(const std::vector<double>& lines, double place, int nearby) {
    while (nearby > 0 && lines[nearby - 1] > place) --nearby;
    while (nearby < static_cast<int>(lines.size()) && lines[nearby] <= place) ++nearby;
    return nearby;
  }

  /// Gray between the given numbers of lines passed; negative: nothing there.
  double at(int passed_x, int passed_y) const {
    const int columns = static_cast<int>(x.size()) - 1, rows = static_cast<int>(y.size()) - 1;
    if (passed_x < 1 || passed_y < 1 || passed_x > columns || passed_y > rows) return -1.0;
    return gray[(passed_y - 1) * columns + passed_x - 1];
  }

 private:
  static std::vector<double> sorted(std::vector<double> lines) {
    std::sort(lines.begin(), lines.end());
    lines.erase(std::unique(lines.begin(), lines.end()), lines.end());
    return lines;
  }
};

/// The printed checkerboard, its white plate of `margin` squares around it, and what covers it.
inline Print printed(const Checkerboard& board, double margin, const PictureOptions& options) {
  const double width = board.squares_x, height = board.squares_y;
  const double inset = 0.5 * (1 - board.hollow_inner_ratio);
  std::vector<double> x{-margin, width + margin, inset, 1 - inset};
  std::vector<double> y{-margin, height + margin, inset, 1 - inset};
  for (int column = 0; column <= board.squares_x; ++column) x.push_back(column);
  for (int row = 0; row <= board.squares_y; ++row) y.push_back(row);
  for (const auto& cover : options.covers) {
    x.insert(x.end(), {cover.x0, cover.x1});
    y.insert(y.end(), {cover.y0, cover.y1});
  }
  Print print(x, y);
  print.paint(-margin, -margin, width + margin, height + margin, options.white);
  for (int row = 0; row < board.squares_y; ++row)
    for (int column = row % 2; column < board.squares_x; column += 2)
      print.paint(column, row, column + 1, row + 1, options.black);
  if (board.hollow_corner) print.paint(inset, inset, 1 - inset, 1 - inset, options.white);
  for (const auto& cover : options.covers) print.paint(cover.x0, cover.y0, cover.x1, cover.y1, cover.gray);
  return print;
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
        const cv::RotatedRect box(
            p, cv::Size2f(uniform(random, 10, 160) * scale, uniform(random, 10, 100) * scale),
            uniform(random, 0, 360));
        cv::Point2f vertices[4];
        box.points(vertices);
        std::vector<cv::Point> polygon(vertices, vertices + 4);
        cv::fillConvexPoly(image, polygon, gray, cv::LINE_AA);
        break;
      }
      case 1: cv::line(image, p, point(), gray, static_cast<int>(uniform(random, 1, 6)), cv::LINE_AA); break;
      case 2:
        cv::circle(image, p, static_cast<int>(uniform(random, 4, 50) * scale), gray, cv::FILLED, cv::LINE_AA);
        break;
      case 3:
        cv::putText(image, "UR5 30 mm", p, cv::FONT_HERSHEY_SIMPLEX, uniform(random, 0.4, 1.5), gray, 2,
                    cv::LINE_AA);
        break;
      case 4:
        cv::circle(image, p, static_cast<int>(uniform(random, 4, 50) * scale), gray, 2, cv::LINE_AA);
        break;
      default: {
        // Perforated sheet: rows of dots.
        const int pitch = static_cast<int>(uniform(random, 6, 14));
        for (int y = 0; y < 6; ++y)
          for (int x = 0; x < 8; ++x)
            cv::circle(image, p + cv::Point(x * pitch, y * pitch), pitch / 3, gray, cv::FILLED, cv::LINE_AA);
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
      : cx(0.5 * (options.width_px - 1)), cy(0.5 * (options.height_px - 1)), focal(options.focal_px),
        k1(options.k1), mirror(options.mirror ? -1.0 : 1.0) {
    using Eigen::Vector3d;
    const Vector3d sight((options.centre_px.x() - cx) / focal, (options.centre_px.y() - cy) / focal, 1.0);
    const Vector3d axis(std::cos(options.tilt_axis_rad), std::sin(options.tilt_axis_rad), 0);
    rotation =
        (Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), sight) *
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

  /// From normalized image coordinates (homogeneous) to places on the board plane, in units of `unit_m`,
  /// with the board's origin at `origin`.
  Eigen::Matrix3d toPlane(double unit_m, const Eigen::Vector2d& origin) const {
    Eigen::Matrix3d to_image;
    to_image << mirror * unit_m * rotation.col(0), unit_m * rotation.col(1), position;
    Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();
    shift.topRightCorner<2, 1>() = origin;
    return shift * to_image.inverse();
  }

  double cx, cy, focal, k1, mirror;
  Eigen::Matrix3d rotation;
  Eigen::Vector3d position;
};

inline std::vector<Eigen::Vector2d> projectOutline(const BoardSpec& board, const PictureOptions& options) {
  const View view(board, options);
  std::vector<Eigen::Vector2d> outline;
  for (const Eigen::Vector3d& corner : board.outline())
    outline.push_back(view.project(corner.x(), corner.y()));
  return outline;
}

namespace picture {

/// Pixels that points of the image may touch, with room for a pixel's own size.
inline cv::Rect boxAround(const std::vector<Eigen::Vector2d>& points, const cv::Mat& image) {
  Eigen::Vector2d low = points[0], high = points[0];
  for (const Eigen::Vector2d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const int x0 = std::clamp(static_cast<int>(low.x()) - 3, 0, image.cols);
  const int x1 = std::clamp(static_cast<int>(high.x()) + 4, 0, image.cols);
  const int y0 = std::clamp(static_cast<int>(low.y()) - 3, 0, image.rows);
  const int y1 = std::clamp(static_cast<int>(high.y()) + 4, 0, image.rows);
  return {x0, y0, x1 - x0, y1 - y0};
}

/// 2^bits points of the unit square in as many different columns and rows (Hammersley's set).
inline std::vector<Eigen::Vector2d> hammersley(int bits) {
  std::vector<Eigen::Vector2d> set;
  const int count = 1 << bits;
  for (int k = 0; k < count; ++k) {
    int reversed = 0;
    for (int bit = 0; bit < bits; ++bit) reversed |= ((k >> bit) & 1) << (bits - 1 - bit);
    set.emplace_back((k + 0.5) / count, (reversed + 0.5) / count);
  }
  return set;
}

/// Draws a print whose origin and unit are given by `to_print` (homogeneous, from normalized image
/// coordinates) over `image`, inside the box of `outline` (px).
///
/// The corners of every pixel are mapped onto the print exactly. Where all four lie between the same lines
/// the pixel has one color; elsewhere 64 rays are cast (a Hammersley set: 64 different columns and rows, so
/// that even an edge along the pixels is placed to 1/128 px), their places on the print interpolated between
/// the pixel's corners: over one pixel the perspective bends by less than 1e-3 px.
inline void draw(const Print& print, const Eigen::Matrix3d& to_print, const View& view,
                 const std::vector<Eigen::Vector2d>& outline, cv::Mat& image) {
  using Eigen::Vector2d;
  const cv::Rect box = boxAround(outline, image);
  const int x0 = box.x, x1 = box.x + box.width, y0 = box.y, y1 = box.y + box.height;
  static const std::vector<Vector2d> rays = hammersley(6);
  // The upper left corners of a row of pixels, on the print.
  struct Place {
    Vector2d at;
    int passed_x, passed_y;
  };
  const auto placesOf = [&](int y, std::vector<Place>& places) {
    places.resize(x1 - x0 + 1);
    int passed_x = 0, passed_y = 0;
    for (int x = x0; x <= x1; ++x) {
      const Vector2d d((x - 0.5 - view.cx) / view.focal, (y - 0.5 - view.cy) / view.focal);
      Vector2d n = d;
      if (view.k1 != 0)
        for (int iteration = 0; iteration < 12; ++iteration) n = d / (1 + view.k1 * n.squaredNorm());
      const Eigen::Vector3d h = to_print * n.homogeneous();
      Place& place = places[x - x0];
      place.at = h.z() > 0 ? Vector2d(h.hnormalized()) : Vector2d(-1e9, -1e9);  // Behind the camera: nothing.
      place.passed_x = passed_x = Print::passed(print.x, place.at.x(), passed_x);
      place.passed_y = passed_y = Print::passed(print.y, place.at.y(), passed_y);
    }
  };
  std::vector<Place> above, below;
  placesOf(y0, above);
  for (int y = y0; y < y1; ++y) {
    placesOf(y + 1, below);
    float* row = image.ptr<float>(y);
    for (int x = x0; x < x1; ++x) {
      const Place& a = above[x - x0];
      const Place& b = above[x - x0 + 1];
      const Place& c = below[x - x0];
      const Place& d = below[x - x0 + 1];
      if (a.passed_x == b.passed_x && a.passed_x == c.passed_x && a.passed_x == d.passed_x &&
          a.passed_y == b.passed_y && a.passed_y == c.passed_y && a.passed_y == d.passed_y) {
        const double gray = print.at(a.passed_x, a.passed_y);
        if (gray >= 0) row[x] = static_cast<float>(gray);
        continue;
      }
      const Vector2d right = b.at - a.at, down = c.at - a.at, both = d.at - c.at - right;
      double sum = 0;
      for (const Vector2d& ray : rays) {
        const Vector2d at = a.at + ray.x() * right + ray.y() * (down + ray.x() * both);
        const double gray =
            print.at(Print::passed(print.x, at.x(), a.passed_x), Print::passed(print.y, at.y(), a.passed_y));
        sum += gray >= 0 ? gray : row[x];
      }
      row[x] = static_cast<float>(sum / rays.size());
    }
    std::swap(above, below);
  }
}

/// A specular highlight, as wide as a few squares.
inline void addHighlight(const Eigen::Vector2d& centre, const PictureOptions& options, cv::Mat& image) {
  const double sigma = 1.5 * options.square_px;
  for (int y = 0; y < image.rows; ++y) {
    if (std::abs(y - centre.y()) > 5 * sigma) continue;
    for (int x = 0; x < image.cols; ++x) {
      const double distance = (Eigen::Vector2d(x, y) - centre).squaredNorm() / (sigma * sigma);
      if (distance < 25)
        image.at<float>(y, x) += static_cast<float>(options.highlight_gray * std::exp(-0.5 * distance));
    }
  }
}

/// Motion blur along a line, then the lens' blur, then uneven light and noise.
inline cv::Mat expose(cv::Mat image, const PictureOptions& options) {
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
          kernel.at<float>(yi + b, xi + a) +=
              static_cast<float>((a ? x - xi : 1 - x + xi) * (b ? y - yi : 1 - y + yi) / kSteps);
    }
    cv::filter2D(image, image, CV_32F, kernel, cv::Point(-1, -1), 0, cv::BORDER_REPLICATE);
  }
  if (options.blur_px > 0)
    cv::GaussianBlur(image, image, cv::Size(), options.blur_px, options.blur_px, cv::BORDER_REPLICATE);
  const double cx = 0.5 * (image.cols - 1), cy = 0.5 * (image.rows - 1);
  for (int y = 0; y < image.rows; ++y) {
    float* row = image.ptr<float>(y);
    for (int x = 0; x < image.cols; ++x)
      row[x] *= static_cast<float>(1 + options.light_gradient *
                                           ((x - cx) / image.cols + 0.5 * (y - cy) / image.rows));
  }
  if (options.noise_gray > 0) {
    cv::RNG random(options.seed + 0x9e3779b97f4a7c15u);
    cv::Mat noise(image.size(), CV_32FC1);
    random.fill(noise, cv::RNG::NORMAL, 0.0, options.noise_gray);
    image += noise;
  }
  cv::Mat gray;
  image.convertTo(gray, CV_8UC1);
  return gray;
}

}  // namespace picture

namespace picture {

/// The background, and where the board is seen on it.
inline Picture begin(const BoardSpec& board, const PictureOptions& options, cv::Mat& image) {
  std::mt19937 random(options.seed);
  const cv::Size size(options.width_px, options.height_px);
  if (options.clutter)
    clutter(size, random).convertTo(image, CV_32F);
  else
    image = cv::Mat(size, CV_32FC1, cv::Scalar(128));
  const View view(board, options);
  Picture result;
  for (const Eigen::Vector3d& corner : board.corners())
    result.corners.push_back(view.project(corner.x(), corner.y()));
  result.outline = projectOutline(board, options);
  return result;
}

}  // namespace picture

/// Renders a checkerboard over clutter, then blur, light and noise. Shares no code with the library beyond
/// BoardSpec.
inline Picture renderPicture(const BoardSpec& board, const PictureOptions& options) {
  using Eigen::Vector2d;
  cv::Mat image;
  Picture result = picture::begin(board, options, image);
  if (options.board) {
    const View view(board, options);
    const Checkerboard& squares = *board.as<Checkerboard>();
    const double square = squares.square_size_m;
    const Vector2d middle(0.5 * squares.squares_x, 0.5 * squares.squares_y);
    std::vector<Vector2d> outline = result.outline;
    for (const auto& cover : options.covers)
      for (const double x : {cover.x0, cover.x1})
        for (const double y : {cover.y0, cover.y1})
          outline.push_back(view.project((x - middle.x()) * square, (y - middle.y()) * square));
    picture::draw(picture::printed(squares, board.margin_m / square, options), view.toPlane(square, middle),
                  view, outline, image);
    if (options.highlight_gray > 0)
      picture::addHighlight(view.project(0.2 * squares.squares_x * square, -0.1 * square), options, image);
  }
  result.gray = picture::expose(image, options);
  return result;
}

}  // namespace servocal::test
