// SPDX-License-Identifier: GPL-3.0-or-later
#include "salvage.h"

#include <algorithm>
#include <fstream>
#include <iterator>
#include <set>

#include "image_file.h"
#include "servocal/core/error.h"
#include "sha256.h"

namespace servocal::session {

std::vector<std::int64_t> reachableIds(const Database& database, const std::string& table) {
  std::set<std::int64_t> ids;
  for (const char* order : {"ASC", "DESC"}) {
    try {
      Statement rows(database, ("SELECT id FROM " + table + " ORDER BY id " + order).c_str());
      while (rows.step()) ids.insert(rows.integer(0));
      break;
    } catch (const Error&) {  // Up to the damage from this end; now from the other.
    }
  }
  return {ids.begin(), ids.end()};
}

std::optional<std::string> objection(const Observation& observation) {
  if (observation.robot) {
    const Eigen::Matrix3d bRe = observation.robot->bMe.rotation();
    if (!observation.robot->bMe.isFinite() || !observation.robot->q.allFinite()) {
      return "its robot pose is not a number";
    }
    if ((bRe * bRe.transpose() - Eigen::Matrix3d::Identity()).norm() > 1e-3)
      return "its robot pose is no rotation";
  }
  for (const StreamObservation& view : observation.views) {
    for (const Corner& corner : view.detection.corners) {
      if (!corner.pixel.allFinite()) return "a corner of camera '" + view.camera + "' is not a number";
    }
  }
  return std::nullopt;
}

std::optional<std::string> imageObjection(const std::filesystem::path& file, const std::string& sha256_text) {
  if (sha256_text.empty()) {
    try {
      checkImage(file);
      return std::nullopt;
    } catch (const Error& error) {
      return error.what();
    }
  }
  std::ifstream in(file, std::ios::binary);
  if (!in) return "image '" + file.string() + "' is not there";
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  if (sha256(bytes.data(), bytes.size()) == sha256_text) return std::nullopt;
  return "image '" + file.string() + "' is not what was stored (" + std::to_string(bytes.size()) + " bytes)";
}

std::vector<std::string*> imageFiles(Observation& observation) {
  std::vector<std::string*> files;
  for (StreamObservation& view : observation.views) {
    if (!view.image_file.empty()) files.push_back(&view.image_file);
    if (view.depth && !view.depth->image_file.empty()) files.push_back(&view.depth->image_file);
  }
  return files;
}

}  // namespace servocal::session
