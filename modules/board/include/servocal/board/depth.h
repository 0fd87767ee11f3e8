// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/observation.h"

namespace servocal::board {

struct BoardDepthOptions {
  double unit_m = 0.001;       ///< Length of one count of the depth image, m.
  double erode_px = 3.0;       ///< Kept from the outline: pixels there mix board and background.
  double gate_ratio = 0.15;    ///< Depths farther than this from the board's expected distance, as a share of
                               ///< it, are not the board. Wide, for nominal intrinsics and uncorrected depth.
  int patches_x = 5;           ///< Patches along the board's x and y.
  int patches_y = 4;
  int min_patch_pixels = 12;   ///< A patch with fewer valid pixels is left out.
  int min_pixels = 100;        ///< In all; fewer are no plane.
  bool white_only = false;     ///< Leave out pixels on or beside black print. A time-of-flight depth depends on
                               ///< how much light comes back; costs more than half of the pixels.
  int corner_window_px = 10;   ///< Side of the square around a corner for CornerDepth.
  double common_sigma_m = 0.0003;  ///< Added (in quadrature) to every patch: what averaging pixels and frames
                                   ///< does not remove (interference, quantization in step over a patch).
};

enum class BoardDepthStatus { kMeasured, kNoBoard, kTooFewPixels, kWrongUnit, kNoPlane };
/// Sentence for the operator: what happened, and what to do about it.
const char* toString(BoardDepthStatus status);

struct BoardDepthOutcome {
  BoardDepthStatus status = BoardDepthStatus::kNoBoard;
  std::string reason;               ///< The same with this image's numbers; empty if kMeasured.
  std::optional<BoardDepth> depth;  ///< Present only if kMeasured. image_file is left empty.
};

/// What raw depth frames (CV_16UC1, zero: no depth) say about the board that `infrared` found in the same
/// pixels: the paper's corner depths, and patches of a plane fit.
///
/// The plane, 1/z = a x + b y + c over the rays (x, y) of the pixels, is fitted over the board's pattern (of a
/// board that is seen in part: over the hull of the corners that were seen), robustly at first, then by plain
/// least squares over the pixels within 3.5 standard deviations: quantized depth must be averaged, a median or
/// a strong robust loss would lock to a step (docs/depth.md). A patch is the mean residual of its pixels, put
/// back on the plane at their centroid, so that it holds what the sensor said there, distortion included.
///
/// DepthPatch::sigma_m is the scatter of single pixels, each averaged over the frames, over the square root of
/// their number, with common_sigma_m in quadrature. Frames are averaged first because a part of a pixel's error
/// does not change from frame to frame. It knows nothing of errors that vary smoothly over the board; those
/// are what the correction is for.
///
/// `camera` gives the rays and the expected distance; a data sheet's is enough (an error of 5 % in the focal
/// length bends the plane by less than the noise).
///
/// @throws std::invalid_argument if there are no frames, a frame is not CV_16UC1 or not of the camera's size,
///   an option is out of range, or a corner id is not the board's.
[[nodiscard]] BoardDepthOutcome measureBoardDepth(const std::vector<cv::Mat>& frames,
                                                  const BoardDetection& infrared, const BoardSpec& board,
                                                  const CameraModel& camera,
                                                  const BoardDepthOptions& options = {});

}  // namespace servocal::board
