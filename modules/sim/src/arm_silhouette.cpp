// SPDX-License-Identifier: GPL-3.0-or-later
#include "arm_silhouette.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "pixel_kernels.h"

namespace servocal::sim {
namespace {

constexpr double kNearestM = 0.2;  // Links nearer than this are left out.
constexpr double kBlurPx = 1.2;

}  // namespace

ArmSilhouette::ArmSilhouette(const Lens& lens, const SensorNoise& noise, const cv::Mat& gray32,
                             const cv::Mat& sigma8)
    : lens_(lens),
      clean_gray32_(gray32),
      clean_sigma8_(sigma8),
      gray32_(gray32.clone()),
      sigma8_(sigma8.clone()) {
  for (int gray = 0; gray < 256; ++gray) sigma_of_gray_[gray] = noise.sigmaEighths(gray);
}

void ArmSilhouette::draw(const std::vector<Capsule>& links) {
  struct Stroke {
    cv::Point2d from, to;
    int width_px;
    double gray;
  };
  std::vector<Stroke> strokes;
  const cv::Rect image(0, 0, lens_.width_px, lens_.height_px);
  cv::Rect region;
  for (const Capsule& link : links) {
    if (std::min(link.from.z(), link.to.z()) < kNearestM) continue;
    // Undistorted on purpose: beyond the image the distortion polynomial means nothing.
    const auto pixel = [&](const Eigen::Vector3d& point) {
      return cv::Point2d(std::clamp(lens_.fx * point.x() / point.z() + lens_.cx, -1e4, 1e4),
                         std::clamp(lens_.fy * point.y() / point.z() + lens_.cy, -1e4, 1e4));
    };
    const double depth = 0.5 * (link.from.z() + link.to.z());
    const int width = std::max(1, static_cast<int>(2.0 * link.radius_m * lens_.fx / depth));
    const Stroke stroke{pixel(link.from), pixel(link.to), width, link.gray};
    const double reach = 0.5 * width + 6.0;
    const cv::Point top_left(static_cast<int>(std::min(stroke.from.x, stroke.to.x) - reach),
                             static_cast<int>(std::min(stroke.from.y, stroke.to.y) - reach));
    const cv::Point bottom_right(static_cast<int>(std::max(stroke.from.x, stroke.to.x) + reach),
                                 static_cast<int>(std::max(stroke.from.y, stroke.to.y) + reach));
    const cv::Rect box = cv::Rect(top_left, bottom_right) & image;
    if (box.empty()) continue;
    region = region.empty() ? box : region | box;
    strokes.push_back(stroke);
  }
  if (!drawn_.empty()) {
    clean_gray32_(drawn_).copyTo(gray32_(drawn_));
    clean_sigma8_(drawn_).copyTo(sigma8_(drawn_));
  }
  drawn_ = region;
  if (region.empty()) return;

  cv::Mat gray(region.size(), CV_8UC1, cv::Scalar(0)), mask(region.size(), CV_8UC1, cv::Scalar(0));
  const cv::Point2d origin(region.x, region.y);
  for (const Stroke& stroke : strokes) {
    cv::line(gray, stroke.from - origin, stroke.to - origin, stroke.gray, stroke.width_px + 4);
    cv::line(mask, stroke.from - origin, stroke.to - origin, 255, stroke.width_px);
  }
  cv::GaussianBlur(mask, mask, cv::Size(5, 5), kBlurPx);
  for (int row = 0; row < region.height; ++row) {
    auto* out = gray32_.ptr<std::int16_t>(region.y + row) + region.x;
    auto* sigma = sigma8_.ptr<std::uint8_t>(region.y + row) + region.x;
    const auto* cover = mask.ptr<std::uint8_t>(row);
    blendRow(region.width, gray.ptr<std::uint8_t>(row), cover, out);
    for (int i = 0; i < region.width; ++i) {
      if (cover[i] != 0) sigma[i] = sigma_of_gray_[out[i] >> 5];
    }
  }
}

}  // namespace servocal::sim
