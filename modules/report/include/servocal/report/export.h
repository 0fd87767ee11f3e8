// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "servocal/core/result.h"

namespace servocal::report {

/// Formats of other programs; docs/exports.md says what each file holds.
enum class Format {
  kRosCameraInfo,
  kRos2StaticTf,
  kUrdf,
  kEasyHandEye2,
  kOpenCv,
  kVisp,
  kKalibr,
  kMrcal,
  kIaiKinect2,
  kColmap,
  kJson,
};
/// "ros-camera-info", "ros2-static-tf", ... with the format they name.
const std::map<std::string, Format>& formats();

/// What a camera's own driver publishes already: where the optical frame of its color image is in a frame
/// that has no parent yet. tf allows one parent per frame, so the calibration then moves that frame.
struct DriverFrame {
  std::string frame;                   ///< "cam1_link"
  Eigen::Isometry3d frame_by_optical;  ///< Pose of the color optical frame in it, m.
};

/// Names of frames in the files.
struct ExportOptions {
  std::string base_frame = "base";  ///< The controller's base. On a UR that is `base`, not `base_link`.
  std::string flange_frame = "tool0";
  std::string board_frame = "board";
  std::map<std::string, DriverFrame> drivers;  ///< By camera.
};

struct ExportedFile {
  std::filesystem::path name;  ///< Relative.
  std::string text;
};

enum class ExportStatus { kComplete, kRefused };

struct Export {
  ExportStatus status = ExportStatus::kRefused;
  std::string reason;               ///< Why it was refused, and what to do; empty if it was not.
  std::vector<ExportedFile> files;  ///< None if refused.
  std::vector<std::string>
      notes;  ///< For the operator: which frame is where, and what was approximated, how well.
};

/// A calibration in another program's format: every camera, color and infrared, numbers with 17 digits. They are those
/// of bestEstimate(); kJson alone holds the result as it is.
///
/// Exact wherever the format can hold the lens. Where it cannot, the export is refused with the reason
/// (Kalibr has no k3), unless approximating is the only way (ViSP has one distortion coefficient, iai_kinect2
/// one depth shift): then the nearest model is found by least squares over the image and its residual is in
/// `notes` and in the file. A lens never changes silently.
///
/// @throws std::invalid_argument if options.drivers names a camera that the result does not have.
[[nodiscard]] Export exportResult(const CalibrationResult& result, Format format,
                                  const ExportOptions& options = {});

/// Writes the files below `folder`, made if missing; files of the same name are replaced.
/// @throws Error (kBadData) if the disk refuses.
/// @throws std::invalid_argument if the export was refused.
void writeExport(const Export& exported, const std::filesystem::path& folder);

}  // namespace servocal::report
