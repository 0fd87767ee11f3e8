// SPDX-License-Identifier: GPL-3.0-or-later
// The claims of docs/results.md about the checkerboard, counted over a range of the bench's frames.
#pragma once

#include <Eigen/Cholesky>
#include <map>

#include "detection_frames.h"
#include "pictures.h"
#include "servocal/board/detector.h"

namespace servocal::test {

struct DetectionCount {
  std::map<int, std::pair<int, int>> by_tilt;  ///< Found within 2 px, shown.
  std::vector<double> rms_px;
  int misplaced = 0;     ///< Found, but farther off.
  int wrong_turns = 0;
  int marks = 0, undecided = 0;  ///< Boards with a mark of at least 6 px; those whose turn stayed open.
  double z_squares = 0;
  int z_count = 0;

  double recall(int tilt_deg) const {
    const auto& [found, shown] = by_tilt.at(tilt_deg);
    return static_cast<double>(found) / shown;
  }
  double zStd() const { return std::sqrt(z_squares / z_count); }
};

inline DetectionCount countBoards(unsigned seed, const cv::Size& camera, int first, int last) {
  const BoardSpec board;
  board::Detector detector(board);
  DetectionCount count;
  for (int frame = first; frame < last; ++frame) {
    const PictureOptions options = boardFrame(seed, board, camera, frame);
    const Picture picture = renderPicture(board, options);
    detector.reset();
    const auto detection = detector.detect(picture.gray);
    auto& [found, shown] = count.by_tilt[kTilts[frame % 8]];
    ++shown;
    if (!detection) continue;
    const double straight = rmsPx(*detection, picture.corners), turned = rmsTurnedPx(*detection, picture.corners);
    if (std::min(straight, turned) > 2.0) {
      ++count.misplaced;
      continue;
    }
    ++found;
    count.rms_px.push_back(std::min(straight, turned));
    const bool is_marked = markSidePx(board, options) >= 6;
    count.marks += is_marked;
    if (!detection->orientation_known) {
      count.undecided += is_marked;
      continue;
    }
    count.wrong_turns += turned < straight;
    for (const Corner& corner : detection->corners) {
      const Eigen::Vector2d error = corner.pixel - picture.corners[corner.id];
      count.z_squares += corner.covariance_px2.llt().matrixL().solve(error).squaredNorm();
      count.z_count += 2;
    }
  }
  return count;
}

/// Numbers of those frames of a kind in which a board was seen where none is.
template <class Frame>
std::vector<int> falseBoards(Frame frame_of, const BoardSpec& wanted, unsigned seed, const cv::Size& camera, int first,
                             int last) {
  std::vector<int> frames;
  board::Detector detector(wanted);
  for (int frame = first; frame < last; ++frame) {
    detector.reset();
    if (detector.detect(frame_of(seed, camera, frame))) frames.push_back(frame);
  }
  return frames;
}

}  // namespace servocal::test
