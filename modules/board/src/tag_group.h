// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "tag_fit.h"

namespace servocal::board {

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

/// Where the board's point `on_board` should be seen, after the `nearest` of these tags (at least one).
TagCorners predictTag(const std::vector<PlacedTag>& tags, const TagCorners& on_board, std::size_t nearest);

}  // namespace servocal::board
