// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "finder.h"
#include "tag_fit.h"
#include "tag_group.h"
#include "tags.h"

namespace servocal::board {
namespace {

using Eigen::Vector2d;

constexpr double kReadablePx = 20.0;  // Side of a tag in the shrunk image that is found reliably.

double shortestSide(const TagCorners& corners) {
  double shortest = (corners[0] - corners[3]).norm();
  for (int k = 0; k < 3; ++k) shortest = std::min(shortest, (corners[k] - corners[k + 1]).norm());
  return shortest;
}

class TagGridFinder final : public Finder {
 public:
  explicit TagGridFinder(const BoardSpec& board)
      : grid_(*board.as<TagGrid>()), tags_(grid_.tags_x * grid_.tags_y) {
    if (tags_ < 1) throw std::invalid_argument("Detector: the board has no tags");
    reader_ = makeAprilTagReader(grid_.border_bits);
    for (int place = 0; place < tags_; ++place) {
      places_[grid_.code(place)] = place;
      TagCorners corners;
      for (int k = 0; k < 4; ++k) corners[k] = board.corner(4 * place + k).head<2>() / grid_.tag_size_m;
      on_board_.push_back(corners);
      cells_.push_back(reader_->cells(grid_.code(place)));
    }
  }

  std::optional<BoardDetection> detect(const cv::Mat& image) override {
    const cv::Mat gray = toGray(image);
    // Large images hold large tags, mostly; small ones are looked for if few large ones are found.
    const double pixels = static_cast<double>(gray.cols) * gray.rows;
    std::vector<PlacedTag> best;
    for (int shrink = pixels > 4e6 ? 4 : pixels > 8e5 ? 2 : 1; shrink >= 1; shrink /= 2) {
      std::vector<PlacedTag> tags = find(gray, shrink);
      if (tags.size() > best.size()) best = std::move(tags);
      if (2 * static_cast<int>(best.size()) >= tags_) break;
    }
    velocity_.setZero();
    last_.clear();
    return accept(best, Vector2d::Zero());
  }

  std::optional<BoardDetection> track(const cv::Mat& image) override {
    if (last_.empty()) return std::nullopt;
    Vector2d low = last_.front().fit.corners[0], high = low;
    double shortest = 1e9, longest = 0;
    for (const PlacedTag& tag : last_) {
      for (int k = 0; k < 4; ++k) {
        const Vector2d& p = tag.fit.corners[k];
        low = low.cwiseMin(p);
        high = high.cwiseMax(p);
        longest = std::max(longest, (p - tag.fit.corners[(k + 1) % 4]).norm());
      }
      shortest = std::min(shortest, shortestSide(tag.fit.corners));
    }
    // A tag more around, for those that come into view, and as far as the board may have moved.
    constexpr double kMotionPx = 40.0;
    const double margin = (static_cast<int>(last_.size()) < tags_ ? 1.5 : 0.3) * longest + kMotionPx;
    low += velocity_.cwiseMin(0.0) - Vector2d::Constant(margin);
    high += velocity_.cwiseMax(0.0) + Vector2d::Constant(margin);
    const int x0 = std::max(0, static_cast<int>(low.x())), y0 = std::max(0, static_cast<int>(low.y()));
    const int x1 = std::min(image.cols, static_cast<int>(high.x()) + 1);
    const int y1 = std::min(image.rows, static_cast<int>(high.y()) + 1);
    if (x1 - x0 < 16 || y1 - y0 < 16) return std::nullopt;
    const cv::Mat gray = toGray(image(cv::Rect(x0, y0, x1 - x0, y1 - y0)));
    const int shrink = std::clamp(static_cast<int>(shortest / kReadablePx), 1, 3);
    std::vector<PlacedTag> tags = find(gray, shrink);
    if (shrink > 1 && 2 * tags.size() < last_.size()) {
      std::vector<PlacedTag> more = find(gray, 1);
      if (more.size() > tags.size()) tags = std::move(more);
    }
    return accept(tags, Vector2d(x0, y0));
  }

  void reset() override {
    last_.clear();
    velocity_.setZero();
  }

 private:
  TagGrid grid_;
  int tags_;
  std::unique_ptr<TagReader> reader_;
  std::map<int, int> places_;                 // By code.
  std::vector<TagCorners> on_board_;          // By place; unit: side of a tag.
  std::vector<std::vector<TagCell>> cells_;   // By place.
  std::vector<PlacedTag> last_;               // Empty: nothing to track.
  Vector2d velocity_ = Vector2d::Zero();      // Of the board, px per frame.

  std::vector<PlacedTag> find(const cv::Mat& gray, int shrink) {
    std::map<int, std::vector<SeenTag>> seen;  // By place.
    for (const SeenTag& tag : reader_->read(gray, shrink)) {
      const auto place = places_.find(tag.code);
      if (place != places_.end()) seen[place->second].push_back(tag);
    }
    std::vector<PlacedTag> tags;
    for (const auto& [place, found] : seen) {
      if (found.size() > 1) continue;  // One of them is not ours; nobody knows which.
      const auto fit = fitTag(gray, found.front().corners, reader_->cellsAcross(), grid_.border_bits, 0.0);
      if (fit) tags.push_back({place, on_board_[place], *fit});
    }
    tags = agreeingTags(tags, tags_ > 1);
    if (!tags.empty()) complete(gray, tags);
    return tags;
  }

  /// Reads the tags that were missed where their neighbors say they are: the reader needs white all
  /// around a tag, so it loses those with a square at their corners (Kalibr) or a shadow across.
  void complete(const cv::Mat& gray, std::vector<PlacedTag>& tags) const {
    std::vector<char> tried(tags_, 0);
    for (const PlacedTag& tag : tags) tried[tag.place] = 1;
    for (std::size_t known = 0; known < tags.size(); ++known) {
      const int column = tags[known].place % grid_.tags_x, row = tags[known].place / grid_.tags_x;
      for (const auto& [dx, dy] : {std::pair(1, 0), std::pair(-1, 0), std::pair(0, 1), std::pair(0, -1)}) {
        const int x = column + dx, y = row + dy;
        if (x < 0 || y < 0 || x >= grid_.tags_x || y >= grid_.tags_y) continue;
        const int place = y * grid_.tags_x + x;
        if (tried[place]) continue;
        tried[place] = 1;
        const TagCorners guess = predictTag(tags, on_board_[place], 4);
        if (!isInside(gray, guess)) continue;
        const double cell = shortestSide(guess) / reader_->cellsAcross();
        const auto fit = fitTag(gray, guess, reader_->cellsAcross(), grid_.border_bits,
                                std::max(1.0, grid_.border_bits * 0.8 * cell));
        if (!fit || wrongCells(gray, *fit, reader_->cellsAcross(), cells_[place]) > 1) continue;
        tags.push_back({place, on_board_[place], *fit});
      }
    }
  }

  static bool isInside(const cv::Mat& gray, const TagCorners& corners) {
    for (const Vector2d& p : corners)
      if (!(p.x() > 1 && p.y() > 1 && p.x() < gray.cols - 2 && p.y() < gray.rows - 2)) return false;
    return true;
  }

  std::optional<BoardDetection> accept(std::vector<PlacedTag> tags, const Vector2d& offset) {
    if (tags.empty()) return std::nullopt;
    std::sort(tags.begin(), tags.end(), [](const auto& a, const auto& b) { return a.place < b.place; });
    BoardDetection detection;
    detection.orientation_known = true;
    for (PlacedTag& tag : tags) {
      for (int k = 0; k < 4; ++k) {
        tag.fit.corners[k] += offset;
        detection.corners.push_back({4 * tag.place + k, tag.fit.corners[k], tag.fit.covariances_px2[k]});
      }
    }
    velocity_ = motionSinceLast(tags);
    last_ = std::move(tags);
    return detection;
  }

  Vector2d motionSinceLast(const std::vector<PlacedTag>& tags) const {
    Vector2d sum = Vector2d::Zero();
    int count = 0;
    for (const PlacedTag& tag : tags)
      for (const PlacedTag& before : last_)
        if (before.place == tag.place) sum += tag.fit.corners[0] - before.fit.corners[0], ++count;
    return count > 0 ? Vector2d(sum / count) : Vector2d(Vector2d::Zero());
  }
};

}  // namespace

std::unique_ptr<Finder> makeTagGridFinder(const BoardSpec& board) { return std::make_unique<TagGridFinder>(board); }

}  // namespace servocal::board
