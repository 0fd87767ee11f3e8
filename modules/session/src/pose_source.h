// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "servocal/core/config_reader.h"
#include "servocal/core/pose.h"
#include "servocal/session/image_set.h"

namespace servocal::session {

/// How a manifest's `poses:` section says that robot poses are written.
struct PoseFormat {
  enum class Rotation { kMatrix, kQuaternion, kRotationVector, kEuler, kVisp };
  Rotation rotation = Rotation::kMatrix;
  bool end_effector_in_base = true;  ///< The file holds bMe; otherwise eMb.
  bool millimetres = false;
  bool degrees = false;
  std::string euler_order;
  std::string files;                 ///< One file per image: a path with {stem} or {name}; or
  std::string table;                 ///< one table for all, a row per image.
  std::string key;                   ///< Of the matrix in its file; empty: the file is bare numbers.
  std::vector<std::string> keys;     ///< In a file: where the components stand, dots for nesting.
  std::vector<std::string> columns;  ///< In a table: what each column holds.
  int skip_lines = 0;                ///< Of the table's head.
};

/// @throws Error (kInvalidConfig).
PoseFormat readPoseFormat(const ConfigReader& section);

/// The robot pose of every image, in the order of `names`. Files are relative to `folder`.
/// @throws Error (kBadData) naming the file, the image or row, and the cause.
std::vector<Pose<Base, EndEffector>> readPoses(const PoseFormat& format, const std::filesystem::path& folder,
                                               const std::vector<std::string>& names);

/// What the same files say under every other meaning that the manifest could have confused with this one
/// (ImageSet::other_readings). A meaning under which they cannot be read is left out.
std::vector<PoseReading> otherReadings(const PoseFormat& format, const std::filesystem::path& folder,
                                       const std::vector<std::string>& names);

}  // namespace servocal::session
