// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>

#include "random.h"

namespace servocal::sim {

/// What a fixed camera sees behind the board: a wall with texture and, with clutter, things of many
/// shapes, small checker-like ones among them, all slightly out of focus. CV_32FC1, gray values without
/// the light's gradient.
cv::Mat drawBackground(int width_px, int height_px, bool clutter, Random& random);

}  // namespace servocal::sim
