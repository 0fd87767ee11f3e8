// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/cell_config.h"
#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal {

const char* toString(Stream stream) {
  switch (stream) {
    case Stream::kColor: return "color";
    case Stream::kInfrared: return "infrared";
    case Stream::kDepth: return "depth";
  }
  return "unknown";
}

const char* toString(DepthSensor sensor) {
  switch (sensor) {
    case DepthSensor::kStructuredLight: return "structured_light";
    case DepthSensor::kTimeOfFlight: return "time_of_flight";
  }
  return "unknown";
}

const char* toString(DriveStatus status) {
  switch (status) {
    case DriveStatus::kReached: return "reached";
    case DriveStatus::kPlateau: return "plateau";
    case DriveStatus::kTargetLost: return "target_lost";
    case DriveStatus::kUnreachable: return "unreachable";
    case DriveStatus::kLimit: return "limit";
    case DriveStatus::kStopped: return "stopped";
  }
  return "unknown";
}

const char* toString(ViewCause cause) {
  switch (cause) {
    case ViewCause::kNone: return "none";
    case ViewCause::kNoBoard: return "no_board";
    case ViewCause::kCorners: return "corners";
    case ViewCause::kBlurred: return "blurred";
    case ViewCause::kRobotPose: return "robot_pose";
    case ViewCause::kPoseFlip: return "pose_flip";
  }
  return "unknown";
}

}  // namespace servocal
