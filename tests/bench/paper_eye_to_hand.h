// SPDX-License-Identifier: GPL-3.0-or-later
// The paper's eye-to-hand experiments: a camera, an arm and depth with written errors; no images.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>

namespace servocal::bench {

constexpr double kNearM = 0.65, kFarM = 1.2 * kNearM;   // The paper's two distances.
constexpr double kLateralM = 0.0012, kDepthM = 0.0015;  // Of the board's place by one corner-depth stop.

/// Errors that are the same at every stop, or smooth, beside those of each stop. Sizes are the simulated
/// cell's: an arm that is off by 0.3 mm RMS over the workspace and comes back to 0.1 mm, a Kinect v2's depth
/// as it measures.
enum class Systematic { kNone, kArmAndDepth };

/// Mean size per axis of the camera of what a point in the base is off by, over the camera's working space.
struct EyeToHandErrors {
  Eigen::Vector3d affine_m, rigid_m;  ///< The paper's estimator and the rigid one; points as the camera
                                      ///< measures them, systematic errors of depth included, noise not.
  Eigen::Vector3d once_more_m;  ///< The paper's, with the noise of one stop: a board that is measured once.
  Eigen::Vector3d ours_m;       ///< By reprojection; points without error.
};

/// One seed's camera, arm, mount and depth.
class EyeToHandCell {
 public:
  explicit EyeToHandCell(std::uint64_t seed);
  ~EyeToHandCell();
  EyeToHandCell(EyeToHandCell&&) noexcept;
  /// Estimates from `count` stops, half of them at each distance, on a spiral over the image. Nothing if one
  /// of the estimators refuses.
  std::optional<EyeToHandErrors> errors(int count, Systematic systematic) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace servocal::bench
