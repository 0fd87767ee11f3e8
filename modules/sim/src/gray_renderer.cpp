// SPDX-License-Identifier: GPL-3.0-or-later
#include "gray_renderer.h"

#include <algorithm>
#include <cmath>

#include "pixel_kernels.h"

namespace servocal::sim {
namespace {

constexpr double kStillPx = 0.05;     // Moving less than this during the exposure is standing still.
constexpr double kPxPerSample = 2.0;  // About the width of the defocus, which hides the steps.
constexpr int kMostSamples = 8;

}  // namespace

GrayRenderer::GrayRenderer(const BoardSpec& board, const Lens& lens, const Light& light, const Tones& tones,
                           const SimulatedSensorConfig& sensor, const cv::Mat& background)
    : board_(board), lens_(lens), sensor_(sensor), rays_(lens), layer_(board, lens, rays_, light, tones),
      noise_(sensor.noise_gray) {
  cv::Mat gray32(lens.height_px, lens.width_px, CV_16SC1), sigma8(lens.height_px, lens.width_px, CV_8UC1);
  for (int v = 0; v < lens.height_px; ++v) {
    for (int u = 0; u < lens.width_px; ++u) {
      const double gray = std::clamp(background.at<float>(v, u) * light.onWall(u, v), 0.0, 255.0);
      gray32.at<std::int16_t>(v, u) = static_cast<std::int16_t>(std::lround(32.0 * gray));
      sigma8.at<std::uint8_t>(v, u) = noise_.sigmaEighths(gray);
    }
  }
  backdrop_ = std::make_unique<ArmSilhouette>(lens, noise_, gray32, sigma8);
}

std::vector<Eigen::Isometry3d> GrayRenderer::subExposures(const BoardMotion& cMo) const {
  const Eigen::Isometry3d first = cMo(0.0), last = cMo(1.0);
  double motion_px = 0.0;
  for (const Eigen::Vector3d& corner : board_.outline()) {
    const Eigen::Vector3d from = first * corner, to = last * corner;
    if (from.z() <= 0.0 || to.z() <= 0.0) continue;
    const Eigen::Vector2d shift = from.head<2>() / from.z() - to.head<2>() / to.z();
    motion_px = std::max(motion_px, lens_.fx * shift.norm());
  }
  if (motion_px < kStillPx) return {cMo(0.5)};
  const int count = std::clamp(static_cast<int>(std::ceil(motion_px / kPxPerSample)) + 1, 2, kMostSamples);
  std::vector<Eigen::Isometry3d> poses;
  for (int i = 0; i < count; ++i) poses.push_back(cMo((i + 0.5) / count));
  return poses;
}

cv::Mat GrayRenderer::render(const BoardMotion& cMo, const std::vector<Capsule>& links, Random& random) {
  const std::vector<Eigen::Isometry3d> poses = subExposures(cMo);
  const double distance = std::max(0.1, poses[poses.size() / 2].translation().z());
  const double off_focus = sensor_.defocus_px_per_diopter * (1.0 / distance - 1.0 / sensor_.focus_distance_m);
  layer_.draw(poses, std::hypot(sensor_.defocus_px, off_focus));
  backdrop_->draw(links);
  noise_.shuffle(random);

  cv::Mat image(lens_.height_px, lens_.width_px, CV_8UC1);
  const cv::Rect& box = layer_.box();
  for (int v = 0; v < lens_.height_px; ++v) {
    const auto* background = backdrop_->gray32().ptr<std::int16_t>(v);
    const auto* sigma = backdrop_->sigma8().ptr<std::uint8_t>(v);
    auto* out = image.ptr<std::uint8_t>(v);
    const bool board_row = v >= box.y && v < box.y + box.height && !layer_.span(v).empty();
    const Span span = board_row ? layer_.span(v) : Span{lens_.width_px, lens_.width_px};
    writeBackgroundRow(span.begin, background, sigma, noise_.row(0, v), out);
    if (!board_row) continue;
    const int row = v - box.y, shift = span.begin - box.x;
    writeBoardRow(span.end - span.begin, layer_.color().ptr<float>(row) + shift,
                  layer_.alpha().ptr<float>(row) + shift, background + span.begin, noise_.row(span.begin, v),
                  static_cast<float>(sensor_.noise_gray), out + span.begin);
    writeBackgroundRow(lens_.width_px - span.end, background + span.end, sigma + span.end,
                       noise_.row(span.end, v), out + span.end);
  }
  return image;
}

}  // namespace servocal::sim
