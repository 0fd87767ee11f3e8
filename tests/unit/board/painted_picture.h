// SPDX-License-Identifier: GPL-3.0-or-later
// Pictures of boards that are not made of rectangles between few lines, or not only.
#pragma once

#include "board_picture.h"

namespace servocal::test {

/// Renders a plate with any print by casting 32 rays per pixel (a Hammersley set: 32 different columns and
/// rows, so that even an edge along the pixels is placed to 1/64 px), then blur, light and noise. `paint(x, y)`:
/// reflectance (0 black, 1 white) at a point of the plate, from the pattern's upper left, in the board's unit
/// (see unitOf).
template <typename Paint>
Picture renderPainted(const BoardSpec& board, const PictureOptions& options, const Paint& paint) {
  using Eigen::Vector2d;
  cv::Mat image;
  Picture result = picture::begin(board, options, image);
  if (options.board) {
    const View view(board, options);
    const double unit = unitOf(board);
    const Vector2d origin = board.patternOutline().front().head<2>() / unit;
    const Vector2d plate = -board.outline().front().head<2>() / unit;  // Half of it.
    const cv::Rect box = picture::boxAround(result.outline, image);
    const Eigen::Matrix3d to_plane = view.toPlane(unit, Vector2d::Zero());
    const std::vector<Vector2d> rays = picture::hammersley(5);
    for (int y = box.y; y < box.y + box.height; ++y) {
      float* row = image.ptr<float>(y);
      for (int x = box.x; x < box.x + box.width; ++x) {
        double sum = 0;
        for (const Vector2d& ray : rays) {
          const Vector2d d((x - 0.5 + ray.x() - view.cx) / view.focal, (y - 0.5 + ray.y() - view.cy) / view.focal);
          Vector2d n = d;
          if (view.k1 != 0)
            for (int iteration = 0; iteration < 6; ++iteration) n = d / (1 + view.k1 * n.squaredNorm());
          const Eigen::Vector3d h = to_plane * n.homogeneous();
          const Vector2d at = h.hnormalized(), from = at - origin;
          double gray = row[x];
          if (h.z() > 0 && std::abs(at.x()) <= plate.x() && std::abs(at.y()) <= plate.y())
            gray = options.black + (options.white - options.black) * paint(from.x(), from.y());
          for (const auto& cover : options.covers)
            if (from.x() > cover.x0 && from.x() < cover.x1 && from.y() > cover.y0 && from.y() < cover.y1)
              gray = cover.gray;
          sum += gray;
        }
        row[x] = static_cast<float>(sum / rays.size());
      }
    }
    if (options.highlight_gray > 0)
      picture::addHighlight(view.project(-0.4 * origin.x() * unit, -0.1 * unit), options, image);
  }
  result.gray = picture::expose(image, options);
  return result;
}

}  // namespace servocal::test
