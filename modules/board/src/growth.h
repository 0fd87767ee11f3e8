// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "lattice.h"
#include "place_index.h"

namespace servocal::board {

/// Steps along the four axes +i, +j, -i, -j of a lattice.
constexpr int kStepI[4] = {1, 0, -1, 0};
constexpr int kStepJ[4] = {0, 1, 0, -1};

/// Adds saddles that no edge led to, where their neighbors say one should be and the squares agree; marks
/// them used.
void growByPrediction(const cv::Mat& smoothed, Lattice& lattice, const PlaceIndex& index,
                      const std::vector<Saddle>& saddles, std::vector<bool>& used);

/// Takes away what edges led to but does not look like a corner of the same pattern.
void dropStrays(const cv::Mat& smoothed, Lattice& lattice);

}  // namespace servocal::board
