// SPDX-License-Identifier: GPL-3.0-or-later
#include <stdexcept>

#include "finder.h"
#include "tag_family.h"
#include "tag_search.h"

namespace servocal::board {
namespace {

std::vector<BoardTag> tagsOf(const BoardSpec& board, const TagGrid& grid) {
  std::vector<BoardTag> tags;
  for (int place = 0; place < grid.tags_x * grid.tags_y; ++place) {
    BoardTag tag;
    tag.code = grid.code(place);
    for (int k = 0; k < 4; ++k) tag.on_board[k] = board.corner(4 * place + k).head<2>() / grid.tag_size_m;
    tag.cells = tagCells(grid.family, tag.code, grid.border_bits);
    tags.push_back(tag);
  }
  return tags;
}

class TagGridFinder final : public Finder {
 public:
  explicit TagGridFinder(const BoardSpec& board, const TagGrid& grid)
      : search_(grid.isAprilTag() ? makeAprilTagReader(grid.border_bits)
                                  : makeArucoReader(grid.family, grid.border_bits),
                grid.border_bits, tagsOf(board, grid)) {}

  std::optional<BoardDetection> detect(const cv::Mat& image) override {
    return detectionOf(search_.detect(image));
  }
  std::optional<BoardDetection> track(const cv::Mat& image) override {
    return detectionOf(search_.track(image));
  }
  void reset() override { search_.reset(); }

 private:
  TagSearch search_;

  static std::optional<BoardDetection> detectionOf(const std::vector<PlacedTag>& tags) {
    if (tags.empty()) return std::nullopt;
    BoardDetection detection;
    detection.orientation_known = true;
    for (const PlacedTag& tag : tags)
      for (int k = 0; k < 4; ++k)
        detection.corners.push_back({4 * tag.place + k, tag.fit.corners[k], tag.fit.covariances_px2[k]});
    return detection;
  }
};

}  // namespace

std::unique_ptr<Finder> makeTagGridFinder(const BoardSpec& board) {
  const TagGrid& grid = *board.as<TagGrid>();
  if (grid.tags_x < 1 || grid.tags_y < 1) throw std::invalid_argument("Detector: the board has no tags");
  return std::make_unique<TagGridFinder>(board, grid);
}

}  // namespace servocal::board
