// SPDX-License-Identifier: GPL-3.0-or-later
// The frames of the detection statistics. Every frame has a seed of its own: a range of them is the same
// whatever was rendered before.
#pragma once

#include "board_picture.h"

namespace servocal::test {

/// Tilts in degrees, in turn.
inline constexpr int kTilts[] = {0, 15, 30, 45, 55, 60, 65, 70};

/// A generator for frame `frame` of kind `kind` of a camera.
inline std::mt19937 frameRandom(unsigned seed, const cv::Size& camera, int kind, int frame) {
  std::seed_seq numbers{static_cast<int>(seed), camera.width, kind, frame};
  return std::mt19937(numbers);
}

/// Size, place, defocus, motion blur, noise, contrast and light, drawn at random; squares of `smallest_px` to
/// `largest_px` where seen from the front.
inline PictureOptions drawOptions(std::mt19937& random, const cv::Size& camera, double tilt_deg,
                                  double smallest_px = 8, double largest_px = 60) {
  const auto uniform = [&](double low, double high) { return picture::uniform(random, low, high); };
  PictureOptions o;
  o.width_px = camera.width;
  o.height_px = camera.height;
  o.focal_px = 0.94 * camera.width;
  o.tilt_rad = tilt_deg * M_PI / 180;
  o.square_px = std::exp(uniform(std::log(smallest_px), std::log(largest_px)));
  o.tilt_axis_rad = uniform(0, 2 * M_PI);
  o.roll_rad = uniform(0, 2 * M_PI);
  o.blur_px = uniform(0, 1) < 0.1 ? uniform(1.5, 3) : uniform(0.5, 1.5);
  o.motion_px = uniform(0, 1) < 0.2 ? uniform(0, 3) : 0;
  o.motion_rad = uniform(0, M_PI);
  o.noise_gray = uniform(1, 5);
  o.black = uniform(10, 60);
  o.white = o.black + uniform(60, 180);
  o.light_gradient = uniform(-0.3, 0.3);
  o.highlight_gray = uniform(0, 1) < 0.2 ? uniform(0, 60) : 0;
  o.k1 = uniform(-0.2, 0.1);
  o.centre_px = {uniform(0, camera.width), uniform(0, camera.height)};
  o.seed = random();
  return o;
}

inline bool wholePlateInside(const BoardSpec& board, const PictureOptions& o) {
  const auto outline = projectOutline(board, o);
  return std::all_of(outline.begin(), outline.end(), [&](const Eigen::Vector2d& p) {
    return p.x() > 2 && p.y() > 2 && p.x() < o.width_px - 3 && p.y() < o.height_px - 3;
  });
}

/// The same until the whole plate is in the image.
inline PictureOptions drawVisible(std::mt19937& random, const BoardSpec& board, const cv::Size& camera,
                                  double tilt_deg, double smallest_px = 8, double largest_px = 60) {
  PictureOptions o = drawOptions(random, camera, tilt_deg, smallest_px, largest_px);
  while (!wholePlateInside(board, o)) o = drawOptions(random, camera, tilt_deg, smallest_px, largest_px);
  return o;
}

/// Frame `frame` with the board in view; in one of eight something is in front of an outer square.
inline PictureOptions boardFrame(unsigned seed, const BoardSpec& board, const cv::Size& camera, int frame) {
  std::mt19937 random = frameRandom(seed, camera, 0, frame);
  PictureOptions o = drawVisible(random, board, camera, kTilts[frame % 8]);
  if (random() % 8 == 0) o.covers.push_back({2.0, -0.6, 2.6, 0.6, 120});
  return o;
}

/// Length of the shortest side of the white inside of the hollow square, px.
inline double markSidePx(const BoardSpec& board, const PictureOptions& options) {
  const Checkerboard& squares = *board.as<Checkerboard>();
  const View view(board, options);
  const double inset = 0.5 * (1 - squares.hollow_inner_ratio);
  const auto at = [&](double x, double y) {
    return view.project((x - 0.5 * squares.squares_x) * squares.square_size_m,
                        (y - 0.5 * squares.squares_y) * squares.square_size_m);
  };
  const Eigen::Vector2d a = at(inset, inset), b = at(1 - inset, inset), c = at(1 - inset, 1 - inset),
                        d = at(inset, 1 - inset);
  return std::min({(a - b).norm(), (b - c).norm(), (c - d).norm(), (d - a).norm()});
}

namespace picture {

/// Regular things that are no checkerboard of the wanted size: tiles, stripes, dots, text, weave, endless
/// squares, by `kind` in [0, 6).
inline cv::Mat texture(std::mt19937& random, const cv::Size& camera, int kind) {
  const double dark = uniform(random, 10, 90), bright = dark + uniform(random, 50, 150);
  const double pitch = uniform(random, 8, 40), angle = uniform(random, 0, M_PI);
  const double c = std::cos(angle), s = std::sin(angle);
  cv::Mat image(camera, CV_8UC1, cv::Scalar(bright));
  if (kind == 3) {
    for (double y = 0; y < camera.height; y += pitch)
      cv::putText(image, "the quick brown fox 0123456789 XXX HHH +++ ### jumps over the lazy dog",
                  {0, static_cast<int>(y)}, cv::FONT_HERSHEY_SIMPLEX, pitch / 30, cv::Scalar(dark),
                  1 + static_cast<int>(pitch / 20), cv::LINE_AA);
  }
  for (int y = 0; y < camera.height && kind != 3; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const double u = (c * x + s * y) / pitch, v = (c * y - s * x) / pitch;
      const double fu = u - std::floor(u), fv = v - std::floor(v);
      double value = bright;
      switch (kind) {
        case 0: value = fu < 0.12 || fv < 0.12 ? dark : bright; break;
        case 1: value = fu < 0.5 ? dark : bright; break;
        case 2: value = std::hypot(fu - 0.5, fv - 0.5) < 0.33 ? dark : bright; break;
        case 4:
          value = 0.5 * (dark + bright) + 0.25 * (bright - dark) * (std::sin(M_PI * u) + std::sin(M_PI * v));
          break;
        default: value = (static_cast<int>(std::floor(u) + std::floor(v)) & 1) ? dark : bright;
      }
      image.at<uchar>(y, x) = cv::saturate_cast<uchar>(value);
    }
  }
  cv::GaussianBlur(image, image, {}, uniform(random, 0.5, 1.5));
  cv::RNG noise(static_cast<std::uint64_t>(random()));
  cv::Mat grain(image.size(), CV_16SC1), sum;
  noise.fill(grain, cv::RNG::NORMAL, 0.0, uniform(random, 1, 5));
  image.convertTo(sum, CV_16SC1);
  sum += grain;
  sum.convertTo(image, CV_8UC1);
  return image;
}

}  // namespace picture

/// Frame `frame` without a board: clutter and textures in turn.
inline cv::Mat emptyFrame(unsigned seed, const cv::Size& camera, int frame) {
  std::mt19937 random = frameRandom(seed, camera, 1, frame);
  if (frame % 2 == 1) return picture::texture(random, camera, (frame / 2) % 6);
  PictureOptions o = drawOptions(random, camera, 0);
  o.board = false;
  return renderPicture(BoardSpec(), o).gray;
}

/// Frame `frame` with a plain board of another size than 7 x 5; every other one may be cut by the image's
/// edge.
inline cv::Mat otherBoardFrame(unsigned seed, const cv::Size& camera, int frame) {
  std::mt19937 random = frameRandom(seed, camera, 2, frame);
  const std::pair<int, int> sizes[] = {{7, 6}, {8, 5}, {9, 7}, {6, 5}, {7, 4}, {10, 7}, {5, 5}, {9, 5}};
  const auto [x, y] = sizes[frame / 2 % 8];
  const BoardSpec other{Checkerboard{x, y, 0.03, false}};
  const double tilt_deg = picture::uniform(random, 0, 55);
  return renderPicture(other, frame % 2 == 0 ? drawVisible(random, other, camera, tilt_deg)
                                             : drawOptions(random, camera, tilt_deg))
      .gray;
}

/// Frame `frame` with the whole hollow board and a strip of some gray over one line of its corners.
inline cv::Mat coveredFrame(unsigned seed, const cv::Size& camera, int frame) {
  std::mt19937 random = frameRandom(seed, camera, 3, frame);
  const BoardSpec board;
  const Checkerboard& squares = *board.as<Checkerboard>();
  PictureOptions o = drawVisible(random, board, camera, picture::uniform(random, 0, 55));
  const double half = picture::uniform(random, 0.25, 0.45), gray = picture::uniform(random, 0, 255);
  if (random() % 2 == 0) {
    const int line = 1 + static_cast<int>(random() % squares.cornersY());
    o.covers.push_back({-1, line - half, squares.squares_x + 1.0, line + half, gray});
  } else {
    const int line = 1 + static_cast<int>(random() % squares.cornersX());
    o.covers.push_back({line - half, -1, line + half, squares.squares_y + 1.0, gray});
  }
  return renderPicture(board, o).gray;
}

}  // namespace servocal::test
