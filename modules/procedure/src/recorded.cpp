// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/procedure/recorded.h"

#include <algorithm>

#include "servocal/board/detector.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/error.h"
#include "servocal/procedure/solve.h"

namespace servocal::procedure {
namespace {

/// @throws Error (kInvalidConfig) if the lens has no parameter of that name.
void apply(const SolveOverrides& overrides, calib::IntrinsicsOptions& options) {
  if (overrides.lens) options.lens = *overrides.lens;
  if (overrides.fixed) options.fixed = *overrides.fixed;
  const std::vector<std::string>& names = parameterNames(options.lens);
  for (const std::string& name : options.fixed) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw Error(ErrorKind::kInvalidConfig, std::string("lens model ") + toString(options.lens) +
                                                 " has no parameter '" + name + "' to fix");
    }
  }
}

}  // namespace

std::vector<Observation> detectImages(const session::ImageSet& images) {
  board::Detector detector(images.board);
  std::vector<Observation> observations;
  for (const session::PosedImage& image : images.images) {
    Observation observation;
    observation.id = static_cast<std::int64_t>(observations.size()) + 1;
    observation.stage = image.name;
    if (image.bMe) {
      observation.robot.emplace();
      observation.robot->bMe = *image.bMe;
    }
    const cv::Mat pixels = session::readImage(image.file);
    detector.reset();  // Two images of a folder have nothing to do with each other.
    if (auto detection = detector.detect(pixels)) {
      StreamObservation view;
      view.camera = images.camera;
      view.width_px = pixels.cols;
      view.height_px = pixels.rows;
      view.detection = std::move(*detection);
      view.image_file = image.name;
      observation.views.push_back(std::move(view));
    }
    observations.push_back(std::move(observation));
  }
  return observations;
}

CalibrationResult solveImages(const session::ImageSet& images, const SolveOverrides& overrides) {
  SolveOptions options;
  options.intrinsics.lens = images.lens;
  options.intrinsics.fixed = images.fixed;
  apply(overrides, options.intrinsics);
  options.mount = images.mount;
  options.robot_sigma_m = images.robot_accuracy_m;
  options.robot_sigma_rad = images.robot_accuracy_rad;
  options.given_intrinsics = images.given_intrinsics;
  return solve(images.board, detectImages(images), options);
}

CalibrationResult solveRecorded(const session::Session& recorded, const SolveOverrides& overrides) {
  const std::string name = "session '" + recorded.folder().string() + "'";
  const std::vector<Observation> observations = recorded.observations();
  if (observations.empty()) {
    throw Error(ErrorKind::kNothingToDo, name + " holds no observation; there is nothing to solve");
  }
  const CellConfig cell = parseCell(recorded.cellText(), "cell file in " + name);
  SolveOptions options;
  apply(overrides, options.intrinsics);
  options.mount = cell.cameras.front().mount;
  for (const CameraConfig& camera : cell.cameras) {
    if (camera.mount != options.mount) {
      throw Error(ErrorKind::kInvalidConfig, name +
                                                 " has fixed cameras and cameras on the flange; a board is "
                                                 "only on one side, they cannot be solved together");
    }
  }
  options.robot_sigma_m = cell.arm.accuracy_m;
  options.robot_sigma_rad = cell.arm.accuracy_rad;
  return solve(recorded.board(), observations, options);
}

}  // namespace servocal::procedure
