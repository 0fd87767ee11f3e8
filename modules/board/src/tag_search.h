// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <map>
#include <memory>
#include <vector>

#include "tag_group.h"
#include "tags.h"

namespace servocal::board {

/// A tag that belongs to the board.
struct BoardTag {
  int code = 0;
  TagCorners on_board;  ///< In units of about a tag's side.
  cv::Mat cells;        ///< See tagCells.
};

/// Finds the tags of a board, measured, in whole images or near the last ones. A tag's place is its index
/// in the board's list; found tags are in the order of their places.
class TagSearch {
 public:
  TagSearch(std::unique_ptr<TagReader> reader, int border_cells, std::vector<BoardTag> board);

  std::vector<PlacedTag> detect(const cv::Mat& image);
  std::vector<PlacedTag> track(const cv::Mat& image);
  void reset();

 private:
  std::vector<PlacedTag> find(const cv::Mat& gray, int shrink);
  void complete(const cv::Mat& gray, std::vector<PlacedTag>& tags) const;
  std::vector<PlacedTag> remember(std::vector<PlacedTag> tags);

  std::unique_ptr<TagReader> reader_;
  int border_cells_;
  std::vector<BoardTag> board_;
  std::map<int, int> places_;                           // By code.
  std::vector<std::vector<int>> neighbors_;             // By place.
  std::vector<PlacedTag> last_;                         // Empty: nothing to track.
  Eigen::Vector2d velocity_ = Eigen::Vector2d::Zero();  // Of the board, px per frame.
};

}  // namespace servocal::board
