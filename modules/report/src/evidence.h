// SPDX-License-Identifier: GPL-3.0-or-later
// What a report computes from observations and from covariances, beyond what the result says.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "servocal/report/report.h"

namespace servocal::report {

struct CornerResidual {
  std::int64_t view = 0;     ///< Observation's id.
  Eigen::Vector2d pixel;     ///< Where the corner was seen, px.
  Eigen::Vector2d residual;  ///< Seen minus predicted, px.
};

/// Residuals of a stream's used views, each with the board pose that fits it best.
std::vector<CornerResidual> cornerResiduals(const ReportInput& input, const std::string& camera,
                                            Stream stream, const IntrinsicsResult& intrinsics);

struct PixelSigma {
  Eigen::Vector2d pixel;
  double sigma_px = 0.0;
};

/// Standard deviation of where a far point falls, by the intrinsics' covariance, over the image: root of the
/// mean square over directions. What a turn of the camera explains is fitted out, since a hand-eye solution
/// or a user would do so. Empty without covariance.
///
/// Source: as mrcal's projection uncertainty (D. Kogan), for points at infinity.
std::vector<PixelSigma> projectionSigma(const IntrinsicsResult& intrinsics, int across, int down);

struct HandEyeStep {
  int views = 0;
  double error_m = 0.0;    ///< Distance of the camera to where all views put it,
  double error_rad = 0.0;  ///< and angle.
  double sigma_m = 0.0;    ///< What the estimate said of itself: length of its standard deviations.
};

/// The hand-eye from the first views alone, for growing numbers of them short of all, in the order in which
/// they were seen.
std::vector<HandEyeStep> handEyeSteps(const ReportInput& input, const CameraResult& camera);

struct DepthSample {
  Eigen::Vector2d pixel;
  double depth_m = 0.0;   ///< By the board's corners.
  double before_m = 0.0;  ///< Error of the depth image as delivered,
  double after_m = 0.0;   ///< and corrected.
};

/// Depth patches against the plane that the board's corners give in the same infrared image.
std::vector<DepthSample> depthSamples(const ReportInput& input, const CameraResult& camera);

/// A corner of the board in the color image, and where the infrared corner with its depth falls there.
struct OverlayCorner {
  std::int64_t view = 0;
  Eigen::Vector2d color;  ///< As seen, px.
  std::optional<Eigen::Vector2d>
      before;  ///< By the data sheets, both cameras in one place, depth as delivered.
  std::optional<Eigen::Vector2d> after;  ///< By the result.
};

/// Of all observations in which both streams saw the board and depth was measured.
std::vector<OverlayCorner> overlayCorners(const ReportInput& input, const CameraResult& camera);

/// Infrared and depth drawn into the whole color image of one view, as data URLs.
struct OverlayPictures {
  std::string before, after;  ///< As in OverlayCorner.
};

/// Nothing if the session kept no images of that view, or the cell file does not know the camera.
std::optional<OverlayPictures> overlayPictures(const ReportInput& input, const CameraResult& camera,
                                               std::int64_t view);

/// Poses of the board in the robot's base, of all observations with a robot pose (fixed cameras); or of the
/// camera that moves.
struct VisitedPose {
  std::string stage;
  Eigen::Isometry3d base_by_moving;
};
std::vector<VisitedPose> visitedPoses(const ReportInput& input, const CameraResult& camera);

}  // namespace servocal::report
