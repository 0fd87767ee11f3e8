// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/board_spec.h"
#include "servocal/core/camera_model.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"

namespace servocal::session {

/// An image of a folder, and where the arm was when it was taken.
struct PosedImage {
  std::filesystem::path file;
  std::string name;  ///< As the manifest names it; for messages and results.
  std::optional<Pose<Base, EndEffector>> bMe;  ///< All images of a set have one, or none has.
};

/// The same pose files read in another way, for the case that robot and images contradict each other.
struct PoseReading {
  std::string what;  ///< Completes "they agree if ...", e.g. "the angles are in degrees (angle_unit: deg)".
  std::vector<Pose<Base, EndEffector>> bMe;  ///< Per image.
};

/// A folder of images with or without robot poses, described by a manifest: what somebody else recorded.
struct ImageSet {
  std::string camera;               ///< Name the camera gets in the result.
  BoardSpec board;
  int width_px = 0;                 ///< Of every image.
  int height_px = 0;
  LensModel lens = LensModel::kPlumbBob;
  std::vector<std::string> fixed;   ///< Lens parameters held at zero, by name.
  std::optional<CameraModel> given_intrinsics;  ///< If present, intrinsics are not solved but believed.
  Mount mount = Mount::kFixed;      ///< "eye_to_hand" and "eye_in_hand" of the manifest.
  double robot_accuracy_m = 0.0003;     ///< Declared robot noise, 1 sigma per axis.
  double robot_accuracy_rad = 0.0005;
  std::vector<PosedImage> images;   ///< In natural order of their names (2 before 10).
  std::string poses_from;           ///< The pose table, or the pattern of the pose files; for messages.
  /// Other units of angle, Euler orders, order of a quaternion, Euler angles for a rotation vector: what the
  /// files would say if the manifest were mistaken. To be named, never believed unasked.
  std::vector<PoseReading> other_readings;
};

/// As loadImageSet, for a manifest that may also describe several cameras (a list `cameras`, the rest in
/// common): one set for each. Images of equal index were taken at the same moment; all sets have equally many.
/// @throws Error as loadImageSet; (kBadData) if the cameras have different numbers of images.
std::vector<ImageSet> loadImageSets(const std::filesystem::path& manifest, const std::filesystem::path& root = {});

/// Reads a manifest (YAML; docs/manifest.md) and everything it points to but the pixels. Relative paths
/// start at `root`, or at the manifest's folder if `root` is empty. Knows no detector: an image without a
/// board is found out later, and drops out together with its pose.
///
/// @throws Error (kInvalidConfig) if the manifest is malformed: file, line, nearest key.
/// @throws Error (kNothingToDo) if no image matches.
/// @throws Error (kBadData) naming file and cause if an image is truncated or of another size than the
///   rest, a pose is missing, not finite, no rotation or evidently in other units, or the counts of
///   images and poses differ.
ImageSet loadImageSet(const std::filesystem::path& manifest, const std::filesystem::path& root = {});

/// An image as the sensor delivered it, 8-bit gray (CV_8UC1); an orientation tag in the file is ignored.
/// @throws Error (kBadData) naming the file if it is missing, truncated or no image.
cv::Mat readImage(const std::filesystem::path& file);

}  // namespace servocal::session
