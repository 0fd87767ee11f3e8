// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "tag_fit.h"

namespace servocal::board {

Eigen::Vector2d centreOf(const TagCorners& corners);

/// A tag whose place on the board is known.
struct PlacedTag {
  int place = 0;
  TagCorners on_board;  ///< In units of about a tag's side.
  TagFit fit;
};

/// The tags that agree on where the board is: all four corners near one homography of the plane, up to
/// what a lens may bend (half a tag's side). Nothing unless they are more than half of all, and at least
/// two if `several`: a code misread elsewhere in the image, or another board's, is not in its place.
std::vector<PlacedTag> agreeingTags(const std::vector<PlacedTag>& tags, bool several);

/// From the board's plane to the image, near `on_board`: after the `nearest` of these tags (at least one).
Eigen::Matrix3d localHomography(const std::vector<PlacedTag>& tags, const Eigen::Vector2d& on_board,
                                std::size_t nearest);
/// Where a tag with these corners on the board should be seen.
TagCorners predictTag(const std::vector<PlacedTag>& tags, const TagCorners& on_board, std::size_t nearest);

}  // namespace servocal::board
