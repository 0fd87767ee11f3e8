// SPDX-License-Identifier: GPL-3.0-or-later
#include "background.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace servocal::sim {
namespace {

constexpr double kWallGray = 118.0;
constexpr double kBlurPx = 1.6;

cv::Point somewhere(const cv::Mat& image, Random& random) {
  const int u = random.integer(0, image.cols - 1);
  return {u, random.integer(0, image.rows - 1)};
}

// Smooth random relief of the given grain, `amplitude` gray values.
void addTexture(cv::Mat& image, int grain_px, double amplitude, Random& random) {
  cv::Mat coarse(image.rows / grain_px + 3, image.cols / grain_px + 3, CV_32FC1);
  coarse.forEach<float>([](float& value, const int*) { value = 0.0F; });
  for (int v = 0; v < coarse.rows; ++v) {
    for (int u = 0; u < coarse.cols; ++u) coarse.at<float>(v, u) = static_cast<float>(random.normal());
  }
  cv::Mat fine;
  cv::resize(coarse, fine, image.size(), 0.0, 0.0, cv::INTER_CUBIC);
  image += amplitude * fine;
}

void addPolygon(cv::Mat& image, double gray, Random& random) {
  const cv::Point centre = somewhere(image, random);
  const double radius = random.uniform(20.0, 180.0);
  const int corners = random.integer(3, 6);
  const double start = random.uniform(0.0, 2.0 * M_PI);
  std::vector<cv::Point> points;
  for (int i = 0; i < corners; ++i) {
    const double angle = start + 2.0 * M_PI * i / corners;
    points.emplace_back(centre.x + static_cast<int>(radius * std::cos(angle)),
                        centre.y + static_cast<int>(radius * std::sin(angle)));
  }
  cv::fillConvexPoly(image, points, gray);
}

// Checkers of a few small squares: what a detector that grows a board from squares stumbles over.
void addSmallChecker(cv::Mat& image, Random& random) {
  const cv::Point corner = somewhere(image, random);
  const int square = random.integer(6, 13);
  const int columns = random.integer(2, 4);
  const int rows = random.integer(2, 3);
  const double angle = random.uniform(0.0, M_PI);
  const double c = std::cos(angle), s = std::sin(angle);
  const double bright = random.uniform(170.0, 220.0);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      std::vector<cv::Point> points;
      for (const auto& [dx, dy] : {std::pair{0, 0}, {1, 0}, {1, 1}, {0, 1}}) {
        const double x = square * (column + dx), y = square * (row + dy);
        points.emplace_back(corner.x + static_cast<int>(c * x - s * y),
                            corner.y + static_cast<int>(s * x + c * y));
      }
      cv::fillConvexPoly(image, points, (row + column) % 2 == 0 ? 35.0 : bright);
    }
  }
}

void addThing(cv::Mat& image, Random& random) {
  const double gray = random.uniform(20.0, 225.0);
  switch (random.integer(0, 4)) {
    case 0: {
      const cv::Point centre = somewhere(image, random);
      const cv::Size axes(random.integer(8, 120), random.integer(8, 120));
      cv::ellipse(image, centre, axes, random.uniform(0.0, 180.0), 0.0, 360.0, gray, cv::FILLED);
      break;
    }
    case 1: {
      const cv::Point corner = somewhere(image, random);
      const cv::Size size(random.integer(10, 260), random.integer(10, 200));
      cv::rectangle(image, cv::Rect(corner, size), gray, cv::FILLED);
      break;
    }
    case 2: {
      const cv::Point from = somewhere(image, random);
      cv::line(image, from, somewhere(image, random), gray, random.integer(2, 9));
      break;
    }
    default: addPolygon(image, gray, random);
  }
}

}  // namespace

cv::Mat drawBackground(int width_px, int height_px, bool clutter, Random& random) {
  cv::Mat image(height_px, width_px, CV_32FC1, cv::Scalar(kWallGray));
  if (!clutter) return image;
  for (int i = 0; i < 70; ++i) addThing(image, random);
  for (int i = 0; i < 12; ++i) addSmallChecker(image, random);
  addTexture(image, 240, 9.0, random);
  addTexture(image, 40, 4.0, random);
  addTexture(image, 6, 2.5, random);
  cv::GaussianBlur(image, image, cv::Size(), kBlurPx);
  image = cv::max(image, 0.0);
  return image;
}

}  // namespace servocal::sim
