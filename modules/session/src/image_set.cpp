// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/session/image_set.h"

#include <algorithm>
#include <map>

#include "given_intrinsics.h"
#include "image_file.h"
#include "image_list.h"
#include "pose_source.h"
#include "servocal/core/config_reader.h"
#include "servocal/core/error.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;

constexpr double kRadPerDeg = 3.14159265358979323846 / 180.0;

BoardSpec boardOf(const ConfigReader& reader, const fs::path& root) {
  if (reader.has("board") == reader.has("board_file")) {
    reader.fail("board", "say either 'board' (a section) or 'board_file' (a board file)");
  }
  return reader.has("board") ? readBoard(reader.section("board"))
                             : loadBoard(root / reader.text("board_file"));
}

std::vector<std::string> imageNames(const ConfigReader& reader, const fs::path& folder) {
  if (reader.has("images") == reader.has("image_list")) {
    reader.fail("images", "say either 'images' (a pattern such as \"*.png\") or 'image_list' (names)");
  }
  std::vector<std::string> names;
  if (reader.has("image_list")) {
    names = reader.texts("image_list");
  } else {
    const std::string pattern = reader.text("images");
    names = matchingFiles(folder, pattern);
    if (names.empty()) {
      std::error_code ignored;
      throw Error(ErrorKind::kNothingToDo,
                  fs::is_directory(folder, ignored)
                      ? "no image in '" + folder.string() + "' matches '" + pattern + "'"
                      : "folder '" + folder.string() + "' is not there (--root says where paths start)");
    }
  }
  if (names.empty()) throw Error(ErrorKind::kNothingToDo, "the manifest lists no image");
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (std::find(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(i), names[i]) !=
        names.begin() + static_cast<std::ptrdiff_t>(i)) {
      reader.fail("image_list", "image '" + names[i] + "' is listed twice");
    }
  }
  return names;
}

std::string sizeText(const ImageSize& size) {
  return std::to_string(size.width_px) + "x" + std::to_string(size.height_px);
}

/// The size of all images; the odd one out is named.
ImageSize commonSize(const std::vector<PosedImage>& images) {
  std::vector<ImageSize> sizes;
  for (const PosedImage& image : images) sizes.push_back(checkImage(image.file));
  ImageSize usual = sizes.front();
  for (const ImageSize& size : sizes) {
    if (std::count(sizes.begin(), sizes.end(), size) > std::count(sizes.begin(), sizes.end(), usual))
      usual = size;
  }
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    if (!(sizes[i] == usual)) {
      throw Error(ErrorKind::kBadData, "image '" + images[i].file.string() + "' has " + sizeText(sizes[i]) +
                                           " px, most others have " + sizeText(usual) +
                                           "; one camera has one size, take it out of the set");
    }
  }
  return usual;
}

std::vector<std::string> fixedParameters(const ConfigReader& reader, LensModel lens) {
  if (!reader.has("fixed")) return {};
  const std::vector<std::string> fixed = reader.texts("fixed");
  const std::vector<std::string>& names = parameterNames(lens);
  for (const std::string& name : fixed) {
    // Focal lengths and principal point are not zero; only distortion can be left out.
    if (std::find(names.begin() + 4, names.end(), name) == names.end()) {
      std::string list;
      for (std::size_t i = 4; i < names.size(); ++i) list += (i == 4 ? "" : ", ") + names[i];
      reader.fail("fixed", "'fixed' names '" + name + "', allowed: " + list);
    }
  }
  return fixed;
}

/// What a manifest says of one camera, before its images are looked for.
struct CameraPart {
  ImageSet set;
  std::string intrinsics_file;
};

CameraPart readCamera(const ConfigReader& reader, const BoardSpec& board) {
  CameraPart part;
  part.set.camera = reader.text("camera", "camera");
  part.set.board = board;
  part.set.lens = static_cast<LensModel>(reader.choice("lens", {"plumb_bob", "rational_polynomial"}, 0));
  part.set.fixed = fixedParameters(reader, part.set.lens);
  part.intrinsics_file = reader.text("intrinsics_file", "");
  // All keys are judged before a file is looked for: a typing mistake is not a missing image.
  for (const char* key : {"images", "image_list"}) reader.has(key);
  return part;
}

void readImages(const ConfigReader& reader, const fs::path& root, const fs::path& folder, CameraPart& part) {
  ImageSet& set = part.set;
  for (const std::string& name : imageNames(reader, folder)) set.images.push_back({folder / name, name, std::nullopt});
  const ImageSize size = commonSize(set.images);
  set.width_px = size.width_px;
  set.height_px = size.height_px;
  if (!part.intrinsics_file.empty()) set.given_intrinsics = readIntrinsics(root / part.intrinsics_file, size);
}

}  // namespace

ImageSet loadImageSet(const fs::path& manifest, const fs::path& root_option) {
  const ConfigReader reader = ConfigReader::fromFile(manifest);
  const fs::path root = root_option.empty() ? manifest.parent_path() : root_option;
  const fs::path folder = (root / reader.text("folder", ".")).lexically_normal();

  CameraPart part = readCamera(reader, boardOf(reader, root));
  ImageSet& set = part.set;
  std::optional<PoseFormat> format;
  if (const auto section = reader.optionalSection("poses")) {
    format = readPoseFormat(*section);
    section->finish();
    set.mount = static_cast<Mount>(reader.choice("mount", {"eye_to_hand", "eye_in_hand"}));
    set.robot_accuracy_m = reader.number("robot_accuracy_m", {1e-6, 0.05}, set.robot_accuracy_m);
    set.robot_accuracy_rad =
        reader.number("robot_accuracy_deg", {1e-5, 5.0}, set.robot_accuracy_rad / kRadPerDeg) * kRadPerDeg;
  }
  for (const char* key : {"mount", "robot_accuracy_m", "robot_accuracy_deg"}) reader.has(key);
  reader.finish();

  readImages(reader, root, folder, part);
  if (format) {
    std::vector<std::string> names;
    for (const PosedImage& image : set.images) names.push_back(image.name);
    const auto poses = readPoses(*format, folder, names);
    for (std::size_t i = 0; i < poses.size(); ++i) set.images[i].bMe = poses[i];
    set.poses_from = (folder / (format->table.empty() ? format->files : format->table)).string();
    set.other_readings = otherReadings(*format, folder, names);
  }
  return set;
}

std::vector<ImageSet> loadImageSets(const fs::path& manifest, const fs::path& root_option) {
  const ConfigReader reader = ConfigReader::fromFile(manifest);
  if (!reader.has("cameras")) return {loadImageSet(manifest, root_option)};
  const fs::path root = root_option.empty() ? manifest.parent_path() : root_option;
  const std::string common_folder = reader.text("folder", ".");
  const BoardSpec board = boardOf(reader, root);
  const std::vector<ConfigReader> cameras = reader.sections("cameras");
  reader.finish();

  std::vector<CameraPart> parts;
  std::vector<fs::path> folders;
  for (const ConfigReader& camera : cameras) {
    camera.text("camera");  // Two cameras need names.
    parts.push_back(readCamera(camera, board));
    folders.push_back((root / camera.text("folder", common_folder)).lexically_normal());
    camera.finish();
    for (std::size_t i = 0; i + 1 < parts.size(); ++i) {
      if (parts[i].set.camera == parts.back().set.camera)
        camera.fail("camera", "two cameras are called '" + parts[i].set.camera + "'");
    }
  }
  std::vector<ImageSet> sets;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    readImages(cameras[i], root, folders[i], parts[i]);
    sets.push_back(std::move(parts[i].set));
    if (sets[i].images.size() != sets[0].images.size()) {
      throw Error(ErrorKind::kBadData, "camera '" + sets[0].camera + "' has " + std::to_string(sets[0].images.size()) +
                                           " images, camera '" + sets[i].camera + "' " +
                                           std::to_string(sets[i].images.size()) +
                                           "; images that were taken together must come in pairs");
    }
  }
  return sets;
}

}  // namespace servocal::session
