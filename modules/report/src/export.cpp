// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/report/export.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <stdexcept>
#include <system_error>

#include "formats.h"
#include "servocal/core/best_estimate.h"
#include "servocal/core/error.h"
#include "servocal/session/session.h"

namespace servocal::report {
namespace {

/// What the numbers are; half a sentence per file would be too much.
std::string estimateNote(const CalibrationResult& result) {
  if (result.joint) return "lenses and poses are those of the joint estimate";
  return "lenses and poses are those found in stages" +
         (result.joint_problem.empty() ? std::string() : "; there is no joint estimate: " + result.joint_problem);
}

Export exportJson(const CalibrationResult& result) {
  Export exported = complete();
  exported.files.push_back({"result.json", session::resultJson(result)});
  exported.notes.emplace_back("result.json is the whole result; docs/result-schema.md explains every key");
  return exported;
}

Exporter exporterOf(Format format) {
  switch (format) {
    case Format::kRosCameraInfo: return exportRosCameraInfo;
    case Format::kRos2StaticTf: return exportRos2StaticTf;
    case Format::kUrdf: return exportUrdf;
    case Format::kEasyHandEye2: return exportEasyHandEye2;
    case Format::kOpenCv: return exportOpenCv;
    case Format::kVisp: return exportVisp;
    case Format::kKalibr: return exportKalibr;
    case Format::kMrcal: return exportMrcal;
    case Format::kIaiKinect2: return exportIaiKinect2;
    case Format::kColmap: return exportColmap;
    case Format::kJson: break;  // Holds the result as it is.
  }
  throw std::invalid_argument("unknown export format");
}

/// Names end up as file names, frames and XML attributes.
bool isPlainName(const std::string& name) {
  return !name.empty() && name.front() != '.' && std::all_of(name.begin(), name.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.' || c == '/';
  });
}

}  // namespace

const std::map<std::string, Format>& formats() {
  static const std::map<std::string, Format> all = {{"ros-camera-info", Format::kRosCameraInfo},
                                                    {"ros2-static-tf", Format::kRos2StaticTf},
                                                    {"urdf", Format::kUrdf},
                                                    {"easy-handeye2", Format::kEasyHandEye2},
                                                    {"opencv", Format::kOpenCv},
                                                    {"visp", Format::kVisp},
                                                    {"kalibr", Format::kKalibr},
                                                    {"mrcal", Format::kMrcal},
                                                    {"iai-kinect2", Format::kIaiKinect2},
                                                    {"colmap", Format::kColmap},
                                                    {"json", Format::kJson}};
  return all;
}

Export exportResult(const CalibrationResult& result, Format format, const ExportOptions& options) {
  std::vector<std::string> names = {options.base_frame, options.flange_frame, options.board_frame};
  for (const CameraResult& camera : result.cameras) {
    if (camera.camera.find('/') != std::string::npos) {
      return refused("camera name '" + camera.camera + "' holds a slash, so no file can carry it");
    }
    names.push_back(camera.camera);
  }
  for (const auto& [camera, driver] : options.drivers) {
    const auto is_it = [&name = camera](const CameraResult& known) { return known.camera == name; };
    if (std::none_of(result.cameras.begin(), result.cameras.end(), is_it)) {
      throw std::invalid_argument("the result has no camera '" + camera + "'");
    }
    names.push_back(driver.frame);
  }
  for (const std::string& name : names) {
    if (format != Format::kJson && !isPlainName(name)) {
      return refused("'" + name +
                     "' cannot name a camera or frame in other programs' files; letters, digits, '_', '-' "
                     "and '.' can");
    }
  }
  if (result.cameras.empty()) return refused("the result has no camera");
  if (format == Format::kJson) return exportJson(result);
  Export exported = exporterOf(format)(bestEstimate(result), options);
  if (exported.status == ExportStatus::kComplete) exported.notes.push_back(estimateNote(result));
  return exported;
}

void writeExport(const Export& exported, const std::filesystem::path& folder) {
  if (exported.status != ExportStatus::kComplete)
    throw std::invalid_argument("a refused export has no files");
  for (const ExportedFile& file : exported.files) {
    const std::filesystem::path path = folder / file.name;
    std::error_code error;
    std::filesystem::create_directories(path.parent_path(), error);
    std::ofstream out(path, std::ios::binary);
    out << file.text;
    out.close();
    if (!out) throw Error(ErrorKind::kBadData, "cannot write '" + path.string() + "'");
  }
}

}  // namespace servocal::report
