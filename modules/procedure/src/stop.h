// SPDX-License-Identifier: GPL-3.0-or-later
// The frames of one settled stop, gathered from several eyes at once.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "eye.h"

namespace servocal::procedure {

/// What one eye saw at a stop.
struct StopView {
  Eye* eye = nullptr;
  std::vector<BoardDetection> detections;
  std::optional<sensor::Frame> first_frame;
  Instant last_stamp{};
  std::vector<sensor::Frame> depth;
};

/// Frames of the eyes, taken in turn so that all cameras expose at the same time. `wanted`, the first of them,
/// gets several tries; another that does not see the board at once is left out. Frames exposed before `rest`
/// are not used. Views with too few detections are left out of the answer; it is empty if `wanted`'s is.
std::vector<StopView> gatherStop(Clock& clock, const std::vector<Eye*>& eyes, Instant rest, bool first_is_wanted);

/// True if the corners stayed where they were in all frames.
bool isStill(const StopView& view);

/// The view as it goes into an observation: detections averaged, depth measured. What is wrong with the depth is
/// left with the eye.
StreamObservation toObservation(const StopView& view, const BoardSpec& board);

}  // namespace servocal::procedure
