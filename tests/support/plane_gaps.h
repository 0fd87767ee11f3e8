// SPDX-License-Identifier: GPL-3.0-or-later
// The board as a plane in the clouds of several depth cameras: how far the planes are apart that a
// calibration makes of it.
#pragma once

#include <map>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/cell_config.h"
#include "servocal/core/result.h"
#include "servocal/robot/guard.h"
#include "servocal/sim/cell.h"

namespace servocal::test {

/// Raw depth frames of the board at one place, the arm at rest.
struct PlaneShot {
  Pose<Base, EndEffector> bMe;                        ///< As the robot reports it.
  std::map<std::string, std::vector<cv::Mat>> depth;  ///< Five frames by camera.
};

/// Holds the board at five places around the start pose, turned to the middle of the time-of-flight cameras
/// of `result`, and takes their depth images. Finds the places by the result, as its user would. Fewer places
/// if the arm does not get there, none for fewer than two such cameras. Moves the simulated arm.
std::vector<PlaneShot> shootPlanes(const CellConfig& cell, const CalibrationResult& result,
                                   sim::Cell& simulation, robot::Guard& guard);

/// Of which numbers a cloud in the base is made.
enum class Cloud {
  kRaw,        ///< Depth as measured.
  kCorrected,  ///< As servocal-rectify corrects it.
};

/// The planes that two cameras' clouds of the board fit.
struct PlaneGap {
  double distance_m =
      0.0;  ///< Of the middle of the second cloud from the first plane, positive towards the first camera.
  double angle_rad = 0.0;  ///< Between the planes.
  int points = 0;          ///< Of the smaller cloud.
};

/// One entry per shot that shows enough of the board (500 points) to both. Lenses and poses are those of `result`: give it
/// bestEstimate() for those of the joint estimate.
std::vector<PlaneGap> planeGaps(const CalibrationResult& result, const std::vector<PlaneShot>& shots,
                                const std::string& first, const std::string& second, Cloud cloud);

}  // namespace servocal::test
