// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/observation.h"

namespace servocal {

const char* toString(Stream stream) {
  switch (stream) {
    case Stream::kColor: return "color";
    case Stream::kInfrared: return "infrared";
    case Stream::kDepth: return "depth";
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

}  // namespace servocal
