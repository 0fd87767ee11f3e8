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

struct OtherBoard {
  std::string what;
  BoardSpec board;
};

/// The mistakes people make in describing a board: rows for columns, inner corners for squares.
std::vector<OtherBoard> likelyMeant(const BoardSpec& board) {
  std::vector<OtherBoard> others;
  BoardSpec swapped = board;
  if (auto* checkerboard = std::get_if<Checkerboard>(&swapped.pattern)) {
    BoardSpec larger = board;
    ++std::get<Checkerboard>(larger.pattern).squares_x;
    ++std::get<Checkerboard>(larger.pattern).squares_y;
    others.push_back({"its inner corners were counted instead of its squares", larger});
    std::swap(checkerboard->squares_x, checkerboard->squares_y);
  } else if (auto* tags = std::get_if<TagGrid>(&swapped.pattern)) {
    std::swap(tags->tags_x, tags->tags_y);
  } else if (auto* charuco = std::get_if<Charuco>(&swapped.pattern)) {
    std::swap(charuco->squares_x, charuco->squares_y);
  } else if (auto* circles = std::get_if<CircleGrid>(&swapped.pattern)) {
    std::swap(circles->circles_x, circles->circles_y);
  }
  others.insert(others.begin(), {"its rows and columns are swapped", swapped});
  return others;
}

std::vector<Observation> detectBoard(const BoardSpec& board, const session::ImageSet& images) {
  board::Detector detector(board);
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

std::size_t boardsFound(const std::vector<Observation>& observations) {
  return static_cast<std::size_t>(std::count_if(observations.begin(), observations.end(), [](const Observation& o) {
    return !o.views.empty();
  }));
}

std::size_t countUsed(const std::vector<ViewResidual>& views) {
  return static_cast<std::size_t>(
      std::count_if(views.begin(), views.end(), [](const ViewResidual& view) { return view.used; }));
}

/// For a set of which less than half could be solved: if a board that is easily confused with the stated one is in at least
/// half of the images, and solves them, the statement is the mistake.
/// @throws Error (kBadData) that says which.
void refuseMisdescribedBoard(const session::ImageSet& images, const std::vector<Observation>& observations) {
  for (const OtherBoard& other : likelyMeant(images.board)) {
    std::vector<Observation> seen;
    try {
      seen = detectBoard(other.board, images);
    } catch (const std::invalid_argument&) {
      continue;  // Not a board that can be detected.
    }
    const std::size_t found = boardsFound(seen);
    if (2 * found < images.images.size() || found < boardsFound(observations)) continue;
    calib::IntrinsicsOptions options;
    options.lens = images.lens;
    options.fixed = images.fixed;
    const auto outcome = calib::solveIntrinsics(other.board, seen, images.camera, Stream::kColor, options);
    if (found >= 3 && !(outcome.result && 2 * countUsed(outcome.result->views) >= found)) continue;
    throw Error(ErrorKind::kBadData,
                "the board is described as " + images.board.describe() + " and seen so in " +
                    std::to_string(boardsFound(observations)) + " of " + std::to_string(images.images.size()) +
                    " images, as " + other.board.describe() + " in " + std::to_string(found) + ": " + other.what);
  }
}

}  // namespace

std::vector<Observation> detectImages(const session::ImageSet& images) { return detectBoard(images.board, images); }

CalibrationResult solveImages(const std::vector<session::ImageSet>& cameras, const SolveOverrides& overrides) {
  if (cameras.empty()) throw std::invalid_argument("solveImages: no camera");
  const session::ImageSet& images = cameras.front();
  SolveOptions options;
  options.intrinsics.lens = images.lens;
  options.intrinsics.fixed = images.fixed;
  apply(overrides, options.intrinsics);
  options.mount = images.mount;
  options.robot_sigma_m = images.robot_accuracy_m;
  options.robot_sigma_rad = images.robot_accuracy_rad;
  options.refuse_contradictions = true;
  if (!images.poses_from.empty()) options.poses_from = "'" + images.poses_from + "'";
  for (const session::PoseReading& reading : images.other_readings) {
    options.readings.push_back({reading.what, {reading.bMe.begin(), reading.bMe.end()}});
  }
  std::vector<Observation> observations = detectImages(images);
  for (const session::ImageSet& camera : cameras) {
    if (camera.given_intrinsics) options.given_intrinsics.emplace(std::pair(camera.camera, Stream::kColor), *camera.given_intrinsics);
    if (&camera == &images) continue;
    if (camera.lens != images.lens || camera.fixed != images.fixed) {
      throw Error(ErrorKind::kInvalidConfig, "cameras '" + images.camera + "' and '" + camera.camera +
                                                 "' of one manifest must have the same lens and fixed");
    }
    const std::vector<Observation> others = detectImages(camera);
    for (std::size_t i = 0; i < observations.size(); ++i) {
      observations[i].views.insert(observations[i].views.end(), others[i].views.begin(), others[i].views.end());
    }
  }
  CalibrationResult result = solve(images.board, observations, options);
  const auto fits = result.cameras.empty() ? 0 : countUsed(result.cameras.front().intrinsics.views);
  if (!images.given_intrinsics && 2 * fits < images.images.size()) refuseMisdescribedBoard(images, observations);
  return result;
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
  options.refuse_contradictions = true;
  options.poses_from = "the robot poses of " + name;
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
  options.depth_sensors = depthSensors(cell);
  options.arm = cell.arm;
  options.workspace = cell.limits.workspace;
  return solve(recorded.board(), observations, options);
}

}  // namespace servocal::procedure
