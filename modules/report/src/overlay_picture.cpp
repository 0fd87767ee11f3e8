// SPDX-License-Identifier: GPL-3.0-or-later
#include "overlay_picture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "servocal/core/base64.h"

namespace servocal::report {
namespace {

constexpr int kWidestPx = 640;
constexpr int kQuality = 85;
constexpr float kJump = 0.03F;  // of the depth: more is an edge
/// A depth pixel is drawn a little larger than its spacing, for what lens and slope stretch.
constexpr double kReach = 0.5 * 1.2;

/// The camera that takes the same image with fewer pixels.
CameraModel smaller(CameraModel camera, double scale) {
  camera.width_px = static_cast<int>(std::lround(camera.width_px * scale));
  camera.height_px = static_cast<int>(std::lround(camera.height_px * scale));
  camera.parameters.head<2>() *= scale;
  camera.parameters.segment<2>(2) = (camera.parameters.segment<2>(2).array() + 0.5) * scale - 0.5;
  return camera;
}

/// What infrared sees in every color pixel, and how far that is; 0: no depth.
struct Seen {
  cv::Mat intensity;  // CV_8UC1
  cv::Mat depth_m;    // CV_32FC1
};

Seen throughDepth(const OverlayImages& images, const Registration& registration, const CameraModel& color) {
  Seen seen{cv::Mat::zeros(color.height_px, color.width_px, CV_8UC1),
            cv::Mat::zeros(color.height_px, color.width_px, CV_32FC1)};
  const CameraModel& infrared = registration.depth.camera;
  for (int row = 0; row < images.depth.rows; ++row) {
    for (int column = 0; column < images.depth.cols; ++column) {
      const std::uint16_t count = images.depth.at<std::uint16_t>(row, column);
      if (count == 0) continue;
      const Eigen::Vector2d from(column, row);
      const auto ray = infrared.unproject(from);
      const auto depth_m = registration.depth.correct(from, 1e-3 * count);
      if (!ray || !depth_m) continue;
      const Eigen::Vector3d point = registration.cMi * Eigen::Vector3d(*depth_m * ray->homogeneous());
      const auto to = color.project(point);
      if (!to) continue;
      const double reach = std::max(0.5, kReach * color.fx() / infrared.fx() * *depth_m / point.z());
      const int left = std::max(0, static_cast<int>(std::ceil(to->x() - reach)));
      const int right = std::min(color.width_px - 1, static_cast<int>(std::floor(to->x() + reach)));
      const int top = std::max(0, static_cast<int>(std::ceil(to->y() - reach)));
      const int bottom = std::min(color.height_px - 1, static_cast<int>(std::floor(to->y() + reach)));
      for (int v = top; v <= bottom; ++v) {
        for (int u = left; u <= right; ++u) {
          float& nearest = seen.depth_m.at<float>(v, u);
          if (nearest > 0.0F && nearest <= static_cast<float>(point.z())) continue;
          nearest = static_cast<float>(point.z());
          seen.intensity.at<std::uint8_t>(v, u) = images.infrared.at<std::uint8_t>(row, column);
        }
      }
    }
  }
  return seen;
}

/// Where the lens stretches, depth pixels leave single pixels between them empty: these take what both sides
/// have.
void fillGaps(Seen& seen) {
  const cv::Mat was = seen.depth_m.clone();
  for (int v = 1; v + 1 < was.rows; ++v) {
    for (int u = 1; u + 1 < was.cols; ++u) {
      if (was.at<float>(v, u) > 0.0F) continue;
      const bool across = was.at<float>(v, u - 1) > 0.0F && was.at<float>(v, u + 1) > 0.0F;
      const bool down = was.at<float>(v - 1, u) > 0.0F && was.at<float>(v + 1, u) > 0.0F;
      if (!across && !down) continue;
      const cv::Point from(across ? u - 1 : u, across ? v : v - 1);
      seen.depth_m.at<float>(v, u) = was.at<float>(from);
      seen.intensity.at<std::uint8_t>(v, u) = seen.intensity.at<std::uint8_t>(from);
    }
  }
}

bool jumps(const cv::Mat& depth_m, int u, int v) {
  const float here = depth_m.at<float>(v, u);
  const auto to = [&](int column, int row) {
    const float there =
        depth_m.at<float>(std::min(row, depth_m.rows - 1), std::min(column, depth_m.cols - 1));
    return there > 0.0F && std::abs(there - here) > kJump * std::min(here, there);
  };
  return here > 0.0F && (to(u + 1, v) || to(u, v + 1));
}

/// Dark and bright of two cameras made alike over the masked pixels.
cv::Mat matched(const cv::Mat& image, const cv::Mat& to, const cv::Mat& mask) {
  cv::Scalar mean, spread, to_mean, to_spread;
  cv::meanStdDev(image, mean, spread, mask);
  cv::meanStdDev(to, to_mean, to_spread, mask);
  const double gain = spread[0] > 1.0 ? to_spread[0] / spread[0] : 1.0;
  cv::Mat out;
  image.convertTo(out, CV_8U, gain, to_mean[0] - gain * mean[0]);
  return out;
}

}  // namespace

cv::Mat readGray(const std::filesystem::path& folder, const std::string& file) {
  if (file.empty() || !std::filesystem::exists(folder / file)) return {};
  cv::Mat image = cv::imread((folder / file).string(), cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
  if (image.depth() == CV_16U) cv::normalize(image.clone(), image, 0, 255, cv::NORM_MINMAX, CV_8U);
  return image;
}

cv::Mat readCounts(const std::filesystem::path& folder, const std::string& file) {
  if (file.empty() || !std::filesystem::exists(folder / file)) return {};
  return cv::imread((folder / file).string(), cv::IMREAD_UNCHANGED);
}

bool fits(const OverlayImages& images, const Registration& registration) {
  const auto has = [](const cv::Mat& image, int type, const CameraModel& camera) {
    return image.type() == type && image.cols == camera.width_px && image.rows == camera.height_px;
  };
  return has(images.color, CV_8UC1, registration.color) &&
         has(images.infrared, CV_8UC1, registration.depth.camera) &&
         has(images.depth, CV_16UC1, registration.depth.camera);
}

cv::Mat drawOverlay(const OverlayImages& images, const Registration& registration) {
  const CameraModel color = smaller(
      registration.color, std::min(1.0, static_cast<double>(kWidestPx) / registration.color.width_px));
  cv::Mat gray;
  cv::resize(images.color, gray, {color.width_px, color.height_px}, 0, 0, cv::INTER_AREA);
  Seen seen = throughDepth(images, registration, color);
  fillGaps(seen);
  const cv::Mat has_depth = seen.depth_m > 0.0F;
  cv::Mat alike = has_depth.clone();
  if (!images.board.empty()) {
    const double scale = static_cast<double>(gray.cols) / images.color.cols;
    const cv::Rect board(cv::Point(images.board.tl() * scale), cv::Point(images.board.br() * scale));
    cv::Mat only = cv::Mat::zeros(gray.size(), CV_8U);
    only(board & cv::Rect({}, gray.size())) = 255;
    alike &= only;
  }
  const cv::Mat infrared = matched(seen.intensity, gray, alike);
  cv::Mat picture(gray.size(), CV_8UC3);
  for (int v = 0; v < gray.rows; ++v) {
    for (int u = 0; u < gray.cols; ++u) {
      const std::uint8_t by_color = gray.at<std::uint8_t>(v, u);
      cv::Vec3b& pixel = picture.at<cv::Vec3b>(v, u);
      if (has_depth.at<std::uint8_t>(v, u) == 0) {
        pixel = cv::Vec3b::all(by_color / 2);
      } else if (jumps(seen.depth_m, u, v)) {
        pixel = {0, 220, 255};
      } else {
        pixel = {by_color, by_color, infrared.at<std::uint8_t>(v, u)};
      }
    }
  }
  return picture;
}

std::string jpegDataUrl(const cv::Mat& picture) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, kQuality});
  return "data:image/jpeg;base64," + base64(bytes);
}

}  // namespace servocal::report
