// SPDX-License-Identifier: GPL-3.0-or-later
#include "tag_search.h"

#include <algorithm>
#include <cmath>

#include "finder.h"

namespace servocal::board {
namespace {

using Eigen::Vector2d;

constexpr double kReadablePx = 20.0;  // Side of a tag in the shrunk image that is found reliably.

bool isInside(const cv::Mat& gray, const TagCorners& corners) {
  for (const Vector2d& p : corners)
    if (!(p.x() > 1 && p.y() > 1 && p.x() < gray.cols - 2 && p.y() < gray.rows - 2)) return false;
  return true;
}

Vector2d meanMotion(const std::vector<PlacedTag>& before, const std::vector<PlacedTag>& now) {
  Vector2d sum = Vector2d::Zero();
  int count = 0;
  for (const PlacedTag& a : before)
    for (const PlacedTag& b : now)
      if (a.place == b.place) sum += b.fit.corners[0] - a.fit.corners[0], ++count;
  return count > 0 ? Vector2d(sum / count) : Vector2d(Vector2d::Zero());
}

}  // namespace

TagSearch::TagSearch(std::unique_ptr<TagReader> reader, int border_cells, std::vector<BoardTag> board)
    : reader_(std::move(reader)), border_cells_(border_cells), board_(std::move(board)),
      neighbors_(board_.size()) {
  const auto distance = [&](std::size_t a, std::size_t b) {
    return (centreOf(board_[a].on_board) - centreOf(board_[b].on_board)).norm();
  };
  for (std::size_t a = 0; a < board_.size(); ++a) {
    places_[board_[a].code] = static_cast<int>(a);
    double nearest = 1e9;
    for (std::size_t b = 0; b < board_.size(); ++b)
      if (a != b) nearest = std::min(nearest, distance(a, b));
    for (std::size_t b = 0; b < board_.size(); ++b)
      if (a != b && distance(a, b) < 1.2 * nearest) neighbors_[a].push_back(static_cast<int>(b));
  }
}

std::vector<PlacedTag> TagSearch::detect(const cv::Mat& image) {
  const cv::Mat gray = toGray(image);
  // Large images hold large tags, mostly; small ones are looked for if few large ones are found.
  const double pixels = static_cast<double>(gray.cols) * gray.rows;
  std::vector<PlacedTag> best;
  for (int shrink = pixels > 4e6 ? 4 : pixels > 8e5 ? 2 : 1; shrink >= 1; shrink /= 2) {
    std::vector<PlacedTag> tags = find(gray, shrink);
    if (tags.size() > best.size()) best = std::move(tags);
    if (2 * best.size() >= board_.size()) break;
  }
  reset();
  return remember(std::move(best));
}

std::vector<PlacedTag> TagSearch::track(const cv::Mat& image) {
  if (last_.empty()) return {};
  Vector2d low = last_.front().fit.corners[0], high = low;
  double shortest = 1e9, longest = 0;
  for (const PlacedTag& tag : last_) {
    for (int k = 0; k < 4; ++k) {
      const Vector2d& p = tag.fit.corners[k];
      const double side = (p - tag.fit.corners[(k + 1) % 4]).norm();
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
      longest = std::max(longest, side);
      shortest = std::min(shortest, side);
    }
  }
  // As far as the board may have moved, and room for tags that come into view.
  constexpr double kMotionPx = 40.0;
  const double margin = (last_.size() < board_.size() ? 1.5 : 0.3) * longest + kMotionPx;
  low += velocity_.cwiseMin(0.0) - Vector2d::Constant(margin);
  high += velocity_.cwiseMax(0.0) + Vector2d::Constant(margin);
  const int x0 = std::max(0, static_cast<int>(low.x())), y0 = std::max(0, static_cast<int>(low.y()));
  const int x1 = std::min(image.cols, static_cast<int>(high.x()) + 1);
  const int y1 = std::min(image.rows, static_cast<int>(high.y()) + 1);
  if (x1 - x0 < 16 || y1 - y0 < 16) return {};
  const cv::Mat gray = toGray(image(cv::Rect(x0, y0, x1 - x0, y1 - y0)));
  const int shrink = std::clamp(static_cast<int>(shortest / kReadablePx), 1, 3);
  std::vector<PlacedTag> tags = find(gray, shrink);
  if (shrink > 1 && 2 * tags.size() < last_.size()) {
    std::vector<PlacedTag> more = find(gray, 1);
    if (more.size() > tags.size()) tags = std::move(more);
  }
  for (PlacedTag& tag : tags)
    for (Vector2d& corner : tag.fit.corners) corner += Vector2d(x0, y0);
  return remember(std::move(tags));
}

void TagSearch::reset() {
  last_.clear();
  velocity_.setZero();
}

std::vector<PlacedTag> TagSearch::find(const cv::Mat& gray, int shrink) {
  std::map<int, std::vector<SeenTag>> seen;  // By place.
  for (const SeenTag& tag : reader_->read(gray, shrink)) {
    const auto place = places_.find(tag.code);
    if (place != places_.end()) seen[place->second].push_back(tag);
  }
  const bool several = board_.size() > 1;
  std::vector<PlacedTag> tags;
  for (const auto& [place, found] : seen) {
    if (found.size() > 1) continue;  // One of them is not ours; nobody knows which.
    const cv::Mat& cells = board_[place].cells;
    const auto fit =
        fitTag(gray, found.front().corners, cells.cols, border_cells_, reader_->cornerErrorPx(shrink));
    // A tag alone has no neighbors to confirm it.
    if (fit && (several || wrongCells(gray, *fit, cells) == 0))
      tags.push_back({place, board_[place].on_board, *fit});
  }
  tags = agreeingTags(tags, several);
  if (!tags.empty()) complete(gray, tags);
  return tags;
}

// Reads the tags that were missed where their neighbors say they are: readers need white all around a tag,
// so they lose those with a square at their corners (Kalibr) or a shadow across.
void TagSearch::complete(const cv::Mat& gray, std::vector<PlacedTag>& tags) const {
  std::vector<char> tried(board_.size(), 0);
  for (const PlacedTag& tag : tags) tried[tag.place] = 1;
  for (std::size_t known = 0; known < tags.size(); ++known) {
    for (const int place : neighbors_[tags[known].place]) {
      if (tried[place]) continue;
      tried[place] = 1;
      const BoardTag& wanted = board_[place];
      const TagCorners guess = predictTag(tags, wanted.on_board, 4);
      if (!isInside(gray, guess)) continue;
      const double cell = shortestSide(guess) / wanted.cells.cols;
      const auto fit =
          fitTag(gray, guess, wanted.cells.cols, border_cells_, std::max(1.0, 0.8 * border_cells_ * cell));
      if (fit && wrongCells(gray, *fit, wanted.cells) <= 1) tags.push_back({place, wanted.on_board, *fit});
    }
  }
}

std::vector<PlacedTag> TagSearch::remember(std::vector<PlacedTag> tags) {
  if (tags.empty()) return tags;  // Tracking goes on from where the board was.
  std::sort(tags.begin(), tags.end(), [](const auto& a, const auto& b) { return a.place < b.place; });
  velocity_ = meanMotion(last_, tags);
  last_ = tags;
  return tags;
}

}  // namespace servocal::board
