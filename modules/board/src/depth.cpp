// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/board/depth.h"

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <opencv2/core.hpp>
#include <stdexcept>

#include "board_area.h"
#include "median.h"

namespace servocal::board {
namespace {

constexpr double kGateSigma = 3.5;
constexpr double kHuberSigma = 1.345;

/// A pixel's depth, averaged over the frames.
struct Sample {
  const BoardPixel* pixel = nullptr;
  double depth_m = 0.0;
  int frames = 0;
};

std::string text(const char* format, double a, double b) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, format, a, b);
  return buffer;
}

void check(const std::vector<cv::Mat>& frames, const CameraModel& camera, const BoardDepthOptions& options) {
  if (frames.empty()) throw std::invalid_argument("no depth frames");
  for (const cv::Mat& frame : frames) {
    if (frame.type() != CV_16UC1) throw std::invalid_argument("a depth frame must be CV_16UC1");
    if (frame.cols != camera.width_px || frame.rows != camera.height_px) {
      throw std::invalid_argument("a depth frame must have the size of the infrared camera's images");
    }
  }
  if (!(options.unit_m > 0.0) || !(options.gate_ratio > 0.0) || options.patches_x < 1 ||
      options.patches_y < 1 || options.corner_window_px < 1 || options.erode_px < 0.0) {
    throw std::invalid_argument("an option of the board's depth is out of range");
  }
}

std::vector<CornerDepth> cornerDepths(const std::vector<cv::Mat>& frames, const BoardDetection& infrared,
                                      const BoardDepthOptions& options) {
  std::vector<CornerDepth> corners;
  const int side = options.corner_window_px;
  for (const Corner& corner : infrared.corners) {
    // An even side has no middle pixel; the window is the one centred nearest to the corner.
    const cv::Rect window(static_cast<int>(std::lround(corner.pixel.x() - 0.5 * (side - 1))),
                          static_cast<int>(std::lround(corner.pixel.y() - 0.5 * (side - 1))), side, side);
    std::vector<double> depths;
    for (const cv::Mat& frame : frames) {
      const cv::Mat part = frame(window & cv::Rect(0, 0, frame.cols, frame.rows));
      for (int row = 0; row < part.rows; ++row) {
        for (int column = 0; column < part.cols; ++column) {
          const std::uint16_t count = part.at<std::uint16_t>(row, column);
          if (count != 0) depths.push_back(count * options.unit_m);
        }
      }
    }
    if (depths.empty()) continue;
    const int pixels = static_cast<int>(depths.size());
    corners.push_back({corner.id, median(std::move(depths)), pixels});
  }
  return corners;
}

/// Mean over the frames of the depths within the gate about the expected one.
std::vector<Sample> averaged(const std::vector<cv::Mat>& frames, const BoardArea& area,
                             const BoardDepthOptions& options) {
  std::vector<Sample> samples;
  for (const BoardPixel& pixel : area.pixels) {
    const double expected_m = 1.0 / area.plane.dot(pixel.ray.homogeneous());
    Sample sample{&pixel, 0.0, 0};
    for (const cv::Mat& frame : frames) {
      const double depth_m = frame.at<std::uint16_t>(pixel.row, pixel.column) * options.unit_m;
      if (std::abs(depth_m - expected_m) > options.gate_ratio * expected_m) continue;
      sample.depth_m += depth_m;
      ++sample.frames;
    }
    if (sample.frames == 0) continue;
    sample.depth_m /= sample.frames;
    samples.push_back(sample);
  }
  return samples;
}

double planeDepth(const Eigen::Vector3d& plane, const BoardPixel& pixel) {
  return 1.0 / plane.dot(pixel.ray.homogeneous());
}

/// Weighted least squares of 1/z, the weights in terms of z. Nothing if the pixels do not span a plane.
std::optional<Eigen::Vector3d> fitPlane(const std::vector<Sample>& samples, const std::vector<double>& weights) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  // Rays about their middle, for the condition of the normal matrix.
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const Sample& sample : samples) middle += sample.pixel->ray / static_cast<double>(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const Eigen::Vector3d basis = (samples[i].pixel->ray - middle).homogeneous();
    // An error dz of the depth is one of dz / z^2 in 1/z.
    const double weight = weights[i] * std::pow(samples[i].depth_m, 4);
    normal += weight * basis * basis.transpose();
    right += weight / samples[i].depth_m * basis;
  }
  const Eigen::Vector3d scale = normal.diagonal().cwiseSqrt();
  if (!(scale.minCoeff() > 0.0)) return std::nullopt;
  const Eigen::Matrix3d scaled = scale.cwiseInverse().asDiagonal() * normal * scale.cwiseInverse().asDiagonal();
  if (Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scaled).eigenvalues()[0] < 1e-6) return std::nullopt;
  Eigen::Vector3d plane = scale.cwiseInverse().asDiagonal() *
                          scaled.ldlt().solve(scale.cwiseInverse().cwiseProduct(right));
  plane.z() -= plane.head<2>().dot(middle);
  return plane;
}

struct PlaneFit {
  Eigen::Vector3d plane;
  std::vector<Sample> samples;  // near the plane
  double rms_m = 0.0;
};

/// Huber from the expected plane, then least squares over what lies near.
std::optional<PlaneFit> robustPlane(const std::vector<Sample>& samples, double floor_m) {
  std::vector<double> weights(samples.size(), 1.0);
  std::optional<Eigen::Vector3d> plane;
  double scale_m = 0.0;
  std::vector<double> errors(samples.size());
  for (int round = 0; round < 12; ++round) {
    plane = fitPlane(samples, weights);
    if (!plane) return std::nullopt;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      errors[i] = std::abs(samples[i].depth_m - planeDepth(*plane, *samples[i].pixel));
    }
    scale_m = std::max(1.4826 * median(errors), floor_m);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      weights[i] = errors[i] < kHuberSigma * scale_m ? 1.0 : kHuberSigma * scale_m / errors[i];
    }
  }
  PlaneFit fit{*plane, {}, 0.0};
  for (int round = 0; round < 8; ++round) {
    std::vector<Sample> near;
    double squares = 0.0;
    for (const Sample& sample : samples) {
      const double error_m = sample.depth_m - planeDepth(fit.plane, *sample.pixel);
      if (!(std::abs(error_m) < kGateSigma * scale_m)) continue;
      near.push_back(sample);
      squares += error_m * error_m;
    }
    if (near.size() < 6) return std::nullopt;
    const bool settled = near.size() == fit.samples.size();
    fit.rms_m = std::sqrt(squares / static_cast<double>(near.size()));
    fit.samples = std::move(near);
    if (settled) break;
    const auto next = fitPlane(fit.samples, std::vector<double>(fit.samples.size(), 1.0));
    if (!next) return std::nullopt;
    fit.plane = *next;
    scale_m = std::max(fit.rms_m, floor_m);
  }
  return fit;
}

std::vector<DepthPatch> patchesOf(const PlaneFit& fit, const BoardArea& area, const CameraModel& camera,
                                  const BoardDepthOptions& options) {
  struct Sum {
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    double residual = 0.0, squares = 0.0;
    int samples = 0, pixels = 0;
  };
  std::vector<Sum> sums(static_cast<std::size_t>(options.patches_x * options.patches_y));
  const Eigen::Vector2d extent = area.max_o - area.min_o;
  for (const Sample& sample : fit.samples) {
    const Eigen::Vector2d place = (sample.pixel->place_o - area.min_o).cwiseQuotient(extent);
    const int column = std::clamp(static_cast<int>(place.x() * options.patches_x), 0, options.patches_x - 1);
    const int row = std::clamp(static_cast<int>(place.y() * options.patches_y), 0, options.patches_y - 1);
    Sum& sum = sums[static_cast<std::size_t>(row * options.patches_x + column)];
    const double residual = sample.depth_m - planeDepth(fit.plane, *sample.pixel);
    sum.pixel += Eigen::Vector2d(sample.pixel->column, sample.pixel->row);
    sum.residual += residual;
    sum.squares += residual * residual;
    ++sum.samples;
    sum.pixels += sample.frames;
  }
  std::vector<DepthPatch> patches;
  double chi_square = 0.0;
  for (const Sum& sum : sums) {
    if (sum.samples < std::max(2, options.min_patch_pixels)) continue;
    const double count = sum.samples, mean = sum.residual / count;
    const Eigen::Vector2d pixel = sum.pixel / count;
    const auto ray = camera.unproject(pixel);
    if (!ray) continue;
    const double variance = std::max(sum.squares / count - mean * mean, 0.0) / (count - 1.0);
    patches.push_back({pixel, 1.0 / fit.plane.dot(ray->homogeneous()) + mean, std::sqrt(variance), sum.pixels});
    if (variance > 0.0) chi_square += mean * mean / variance;
  }
  // Neighboring pixels err alike, and as much from frame to frame: a mean over a patch is worse than its pixels'
  // scatter says. How much worse, the patches' own scatter about the plane tells; it has three parameters.
  const double degrees = std::max(1.0, static_cast<double>(patches.size()) - 3.0);
  const double worse = std::sqrt(std::max(1.0, chi_square / degrees));
  for (DepthPatch& patch : patches) patch.sigma_m = std::hypot(worse * patch.sigma_m, options.common_sigma_m);
  return patches;
}

}  // namespace

const char* toString(BoardDepthStatus status) {
  switch (status) {
    case BoardDepthStatus::kMeasured: return "the board's depth was measured";
    case BoardDepthStatus::kNoBoard:
      return "the infrared corners do not determine where the board is: fewer than four, or all on a line";
    case BoardDepthStatus::kTooFewPixels:
      return "too few pixels of the board carry a depth: too near, too oblique, a highlight, or out of range";
    case BoardDepthStatus::kWrongUnit:
      return "the depth is off by a power of ten against the board's size: check the unit of the depth image";
    case BoardDepthStatus::kNoPlane:
      return "the depth is no plane where the infrared image shows the board: something is in front of it, or "
             "depth and infrared image do not share their pixels";
  }
  return "";
}

BoardDepthOutcome measureBoardDepth(const std::vector<cv::Mat>& frames, const BoardDetection& infrared,
                                    const BoardSpec& board, const CameraModel& camera,
                                    const BoardDepthOptions& options) {
  check(frames, camera, options);
  const auto area = boardArea(board, camera, infrared, options.erode_px, options.white_only);
  if (!area) return {BoardDepthStatus::kNoBoard, toString(BoardDepthStatus::kNoBoard), {}};

  // Ratio of seen to expected distance, before any gate.
  std::vector<double> ratios;
  for (const BoardPixel& pixel : area->pixels) {
    const std::uint16_t count = frames.front().at<std::uint16_t>(pixel.row, pixel.column);
    if (count != 0) ratios.push_back(count * options.unit_m * area->plane.dot(pixel.ray.homogeneous()));
  }
  if (static_cast<int>(ratios.size()) < options.min_pixels) {
    return {BoardDepthStatus::kTooFewPixels,
            text("only %.0f of the board's %.0f pixels carry a depth: too near, too oblique, a highlight, or out of "
                 "range", static_cast<double>(ratios.size()), static_cast<double>(area->pixels.size())), {}};
  }
  const double ratio = median(std::move(ratios));
  const double power = std::round(std::log10(ratio));
  if (power != 0.0 && std::abs(std::log10(ratio) - power) < 0.15) {
    return {BoardDepthStatus::kWrongUnit,
            text("the depth image puts the board %.3g times as far as its size does: one count is probably %.0e m, "
                 "or the board's size is wrong", ratio, options.unit_m * std::pow(10.0, -power)), {}};
  }

  const std::vector<Sample> samples = averaged(frames, *area, options);
  BoardDepthOutcome refusal{BoardDepthStatus::kNoPlane,
                            text("the depth is no plane at the board: its median is %.2f times the distance by the "
                                 "board's size, and %.0f %% of the pixels are near that distance",
                                 ratio, 100.0 * static_cast<double>(samples.size()) /
                                            static_cast<double>(area->pixels.size())), {}};
  if (static_cast<int>(samples.size()) < options.min_pixels) return refusal;
  // A step of the counts, evenly filled, has this standard deviation.
  const auto fit = robustPlane(samples, options.unit_m / std::sqrt(12.0));
  if (!fit || 2 * fit->samples.size() < samples.size()) return refusal;

  BoardDepth depth;
  depth.corners = cornerDepths(frames, infrared, options);
  depth.patches = patchesOf(*fit, *area, camera, options);
  depth.frames = static_cast<int>(frames.size());
  double squares = 0.0;
  int seen = 0;
  for (const Sample& sample : fit->samples) {
    const double expected_m = planeDepth(fit->plane, *sample.pixel);
    for (const cv::Mat& frame : frames) {
      const double depth_m = frame.at<std::uint16_t>(sample.pixel->row, sample.pixel->column) * options.unit_m;
      if (std::abs(depth_m - expected_m) > options.gate_ratio * expected_m) continue;
      squares += (depth_m - expected_m) * (depth_m - expected_m);
      ++seen;
    }
  }
  depth.plane_rms_m = std::sqrt(squares / seen);
  depth.valid_share = seen / static_cast<double>(area->pixels.size() * frames.size());
  if (depth.patches.empty()) {
    return {BoardDepthStatus::kTooFewPixels, "no patch of the board has enough pixels with depth", {}};
  }
  return {BoardDepthStatus::kMeasured, "", std::move(depth)};
}

}  // namespace servocal::board
