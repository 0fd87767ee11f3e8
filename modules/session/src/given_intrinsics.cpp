// SPDX-License-Identifier: GPL-3.0-or-later
#include "given_intrinsics.h"

#include <cmath>
#include <fstream>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/config_reader.h"
#include "servocal/core/error.h"

namespace servocal::session {
namespace {

/// What the two kinds of files have in common.
struct Raw {
  std::vector<double> camera_matrix;
  std::vector<double> distortion;
  std::string model;
  int width_px = 0;
  int height_px = 0;
};

[[noreturn]] void refuse(const std::filesystem::path& file, const std::string& cause) {
  throw Error(ErrorKind::kBadData, "intrinsics file '" + file.string() + "': " + cause);
}

const std::vector<std::string> kMatrixKeys = {"camera_matrix", "cameraMatrix", "K", "M1"};
const std::vector<std::string> kDistortionKeys = {"distortion_coefficients", "distCoeffs", "dist_coeffs", "dist",
                                                  "distortionCoefficients",  "D",          "D1"};

std::vector<double> numbersOf(const cv::FileStorage& storage, const std::vector<std::string>& keys) {
  for (const std::string& key : keys) {
    if (storage[key].empty()) continue;
    cv::Mat matrix;
    storage[key] >> matrix;
    matrix.convertTo(matrix, CV_64F);
    return {matrix.begin<double>(), matrix.end<double>()};
  }
  return {};
}

Raw readOpenCv(const std::filesystem::path& file) {
  Raw raw;
  try {
    const cv::FileStorage storage(file.string(), cv::FileStorage::READ);
    raw.camera_matrix = numbersOf(storage, kMatrixKeys);
    raw.distortion = numbersOf(storage, kDistortionKeys);
    if (!storage["image_width"].empty()) raw.width_px = static_cast<int>(storage["image_width"]);
    if (!storage["image_height"].empty()) raw.height_px = static_cast<int>(storage["image_height"]);
  } catch (const cv::Exception& error) {
    refuse(file, "OpenCV cannot read it: " + error.err);
  }
  return raw;
}

std::vector<double> numbersOf(const ConfigReader& reader, const std::vector<std::string>& keys, int rows) {
  for (const std::string& key : keys) {
    if (!reader.has(key)) continue;
    if (rows == 3) {
      const Eigen::MatrixXd matrix = reader.matrix(key, 3, 3, {});
      const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> by_rows = matrix;
      return {by_rows.data(), by_rows.data() + 9};
    }
    return key == "D" ? reader.numbers(key, 0, {}) : reader.section(key).numbers("data", 0, {});
  }
  return {};
}

Raw readCameraInfo(const std::filesystem::path& file) {
  Raw raw;
  try {
    const ConfigReader reader = ConfigReader::fromFile(file);
    raw.camera_matrix = numbersOf(reader, kMatrixKeys, 3);
    raw.distortion = numbersOf(reader, kDistortionKeys, 1);
    raw.model = reader.text("distortion_model", "");
    raw.width_px = reader.integer("image_width", {1, 100000}, 0);
    raw.height_px = reader.integer("image_height", {1, 100000}, 0);
  } catch (const Error& error) {
    throw Error(ErrorKind::kBadData, error.what());
  }
  return raw;
}

bool isOpenCv(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line.rfind("%YAML:1.0", 0) == 0 || line.rfind("<?xml", 0) == 0;
}

}  // namespace

CameraModel readIntrinsics(const std::filesystem::path& file, const ImageSize& size) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) refuse(file, "there is no such file");
  const Raw raw = isOpenCv(file) ? readOpenCv(file) : readCameraInfo(file);
  if (raw.camera_matrix.size() != 9) refuse(file, "it has no 3x3 camera_matrix");
  if (!raw.model.empty() && raw.model != "plumb_bob" && raw.model != "rational_polynomial") {
    refuse(file, "lens model '" + raw.model + "' is none of plumb_bob, rational_polynomial");
  }
  if ((raw.width_px != 0 && raw.width_px != size.width_px) ||
      (raw.height_px != 0 && raw.height_px != size.height_px)) {
    refuse(file, "it was made for images of " + std::to_string(raw.width_px) + "x" +
                     std::to_string(raw.height_px) + " px, these have " + std::to_string(size.width_px) +
                     "x" + std::to_string(size.height_px));
  }
  if (raw.distortion.size() > 14) refuse(file, "it has more distortion coefficients than any model");
  for (std::size_t i = 8; i < raw.distortion.size(); ++i) {
    if (raw.distortion[i] != 0.0) refuse(file, "thin-prism and tilt coefficients are not supported");
  }
  const Eigen::Matrix3d k =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(raw.camera_matrix.data());
  if (!k.allFinite() || k(0, 0) <= 0.0 || k(1, 1) <= 0.0) refuse(file, "its focal lengths are not positive");
  CameraModel camera;
  camera.lens = raw.distortion.size() > 5 ? LensModel::kRational : LensModel::kPlumbBob;
  camera.width_px = size.width_px;
  camera.height_px = size.height_px;
  camera.parameters = Eigen::VectorXd::Zero(parameterCount(camera.lens));
  camera.parameters.head<4>() << k(0, 0), k(1, 1), k(0, 2), k(1, 2);
  for (std::size_t i = 0; i < std::min<std::size_t>(raw.distortion.size(), 8); ++i) {
    if (!std::isfinite(raw.distortion[i])) refuse(file, "a distortion coefficient is not finite");
    camera.parameters[static_cast<Eigen::Index>(4 + i)] = raw.distortion[i];
  }
  return camera;
}

}  // namespace servocal::session
