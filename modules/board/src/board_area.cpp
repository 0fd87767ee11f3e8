// SPDX-License-Identifier: GPL-3.0-or-later
#include "board_area.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>

#include "servocal/board/artwork.h"
#include "warp.h"

namespace servocal::board {
namespace {

/// Outline on the board (m): the whole pattern, or the hull of what was seen.
std::vector<Eigen::Vector2d> usedOutline(const BoardSpec& board, const BoardDetection& detection) {
  std::vector<Eigen::Vector2d> outline;
  if (static_cast<int>(detection.corners.size()) == board.cornerCount()) {
    for (const Eigen::Vector3d& point : board.patternOutline()) outline.push_back(point.head<2>());
    return outline;
  }
  std::vector<cv::Point2f> points, hull;
  for (const Corner& corner : detection.corners) {
    const Eigen::Vector3d point = board.corner(corner.id);
    points.emplace_back(static_cast<float>(point.x()), static_cast<float>(point.y()));
  }
  cv::convexHull(points, hull);
  for (const cv::Point2f& point : hull) outline.emplace_back(point.x, point.y);
  return outline;
}

bool isWhite(const std::vector<Shape>& print, const Eigen::Vector2d& place) {
  bool white = true;
  for (const Shape& shape : print) {
    const Eigen::Vector2d from = (place - shape.centre).cwiseAbs();
    const bool inside = shape.kind == Shape::Kind::kDisc ? from.norm() < shape.half_size.x()
                                                         : (from.array() < shape.half_size.array()).all();
    if (inside) white = !shape.black;
  }
  return white;
}

}  // namespace

std::optional<BoardArea> boardArea(const BoardSpec& board, const CameraModel& camera,
                                   const BoardDetection& detection, double erode_px, bool white_only) {
  std::vector<Eigen::Vector2d> places, rays;
  double extent = 0.0;
  for (const Corner& corner : detection.corners) {
    if (corner.id < 0 || corner.id >= board.cornerCount()) {
      throw std::invalid_argument("corner id " + std::to_string(corner.id) + " is not one of the board's");
    }
    const auto ray = camera.unproject(corner.pixel);
    if (!ray) continue;
    rays.push_back(*ray);
    places.push_back(board.corner(corner.id).head<2>());
    extent = std::max(extent, places.back().cwiseAbs().maxCoeff());
  }
  if (rays.size() < 4 || !(extent > 0.0)) return std::nullopt;
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& place : places) middle += place / static_cast<double>(places.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& place : places) scatter += (place - middle) * (place - middle).transpose();
  // All on a line: the smaller extent, by the product and the sum of their squares.
  if (scatter.determinant() < 1e-6 * scatter.trace() * scatter.trace()) return std::nullopt;
  for (Eigen::Vector2d& place : places) place /= extent;
  Eigen::Matrix3d homography = fitHomography(places, rays);
  homography.leftCols<2>() /= extent;
  // A pose has two axes of length one; a homography any scale and sign.
  const double scale = std::sqrt(homography.col(0).norm() * homography.col(1).norm());
  homography /= homography(2, 2) < 0.0 ? -scale : scale;
  if (!homography.allFinite() || std::abs(homography.determinant()) < 1e-12) return std::nullopt;
  const Eigen::Matrix3d inverse = homography.inverse();

  BoardArea area;
  area.plane = inverse.row(2).transpose();
  const std::vector<Eigen::Vector2d> outline = usedOutline(board, detection);
  area.min_o = area.max_o = outline.front();
  // Sides are bent by the lens: points along them, not the corners alone.
  constexpr int kSteps = 8;
  std::vector<cv::Point2f> contour;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    area.min_o = area.min_o.cwiseMin(outline[i]);
    area.max_o = area.max_o.cwiseMax(outline[i]);
    for (int k = 0; k < kSteps; ++k) {
      const Eigen::Vector2d place =
          outline[i] + (outline[(i + 1) % outline.size()] - outline[i]) * (k / double(kSteps));
      const Eigen::Vector3d point = homography * place.homogeneous();
      const auto pixel = camera.project(point);
      if (!pixel) return std::nullopt;
      contour.emplace_back(static_cast<float>(pixel->x()), static_cast<float>(pixel->y()));
    }
  }
  const cv::Rect box = cv::boundingRect(contour) & cv::Rect(0, 0, camera.width_px, camera.height_px);
  const std::vector<Shape> print = white_only ? artwork(board) : std::vector<Shape>{};
  for (int row = box.y; row < box.y + box.height; ++row) {
    for (int column = box.x; column < box.x + box.width; ++column) {
      const cv::Point2f at(static_cast<float>(column), static_cast<float>(row));
      if (cv::pointPolygonTest(contour, at, true) < erode_px) continue;
      const auto ray = camera.unproject({column, row});
      if (!ray) continue;
      BoardPixel pixel{column, row, *ray, (inverse * ray->homogeneous()).hnormalized()};
      if (white_only) {
        // Its neighbors at a pixel's distance, by the board's scale there.
        const double px_m = 1.0 / (area.plane.dot(ray->homogeneous()) * std::min(camera.fx(), camera.fy()));
        bool white = isWhite(print, pixel.place_o);
        for (const Eigen::Vector2d& step : {Eigen::Vector2d(px_m, 0), Eigen::Vector2d(-px_m, 0),
                                            Eigen::Vector2d(0, px_m), Eigen::Vector2d(0, -px_m)}) {
          white = white && isWhite(print, pixel.place_o + step);
        }
        if (!white) continue;
      }
      area.pixels.push_back(pixel);
    }
  }
  return area;
}

}  // namespace servocal::board
