// SPDX-License-Identifier: GPL-3.0-or-later
#include "board_observer.h"

#include "servocal/calib/board_pose.h"
#include "servocal/sensor/exposure.h"

namespace servocal::procedure {
namespace {

// A plane seen from afar has two poses that fit almost alike; below this ratio of residuals the better
// fit decides alone.
constexpr double kClearlyBetter = 0.6;

}  // namespace

BoardObserver::BoardObserver(const BoardSpec& board, sensor::RgbdCamera& camera, Stream stream,
                             const CameraModel& model)
    : board_(board), camera_(camera), stream_(stream), model_(model), detector_(board) {}

servo::Look BoardObserver::look(Instant deadline) {
  servo::Look look;
  const auto seen = see(deadline);
  if (!seen) return look;
  look.frame = seen->frame.stamp;
  if (!seen->detection || !isUsable(*seen->detection)) return look;
  const auto cMo = poseOf(*seen->detection, seen->frame.stamp);
  if (!cMo) return look;
  servo::Sight sight;
  sight.stamp = seen->frame.stamp;
  sight.cMo = *cMo;
  // The control law wants every point of the target; those not seen are where the pose puts them.
  auto corner = seen->detection->corners.begin();
  for (int id = 0; id < board_.cornerCount(); ++id) {
    if (corner != seen->detection->corners.end() && corner->id == id) {
      sight.pixels.push_back((corner++)->pixel);
    } else if (const auto predicted = model_.project(*cMo * board_.corner(id))) {
      sight.pixels.push_back(*predicted);
    } else {
      return look;
    }
  }
  look.sight = std::move(sight);
  return look;
}

std::optional<SeenFrame> BoardObserver::see(Instant deadline) {
  auto frame = camera_.next(stream_, deadline);
  if (!frame) return std::nullopt;
  SeenFrame seen;
  seen.detection = detector_.track(frame->image);
  if (!seen.detection) seen.detection = detector_.detect(frame->image);
  seen.frame = std::move(*frame);
  ++looks_;
  if (!seen.detection) {
    if (auto trouble = sensor::exposureTrouble(seen.frame.image)) {
      ++badly_exposed_;
      light_trouble_ = *std::move(trouble);
    }
  }
  if (watcher_) watcher_(seen);
  return seen;
}

std::optional<std::string> BoardObserver::lightTrouble() const {
  if (2 * badly_exposed_ <= looks_) return std::nullopt;
  return light_trouble_;
}

bool BoardObserver::isUsable(const BoardDetection& detection) const {
  // A turned board would turn the servo error: without a known orientation there is no sight.
  return detection.orientation_known && 2 * static_cast<int>(detection.corners.size()) >= board_.cornerCount();
}

std::optional<Pose<Color, Board>> BoardObserver::poseOf(const BoardDetection& detection, Instant stamp) {
  const auto poses = calib::boardPoses(board_, model_, detection);
  if (poses.empty()) return std::nullopt;
  std::size_t best = 0;
  if (poses.size() > 1 && poses[0].rms_px > kClearlyBetter * poses[1].rms_px) {
    const auto expected = predict_ ? predict_(stamp) : std::nullopt;
    const auto& near = expected ? expected : last_pose_;
    if (near && angleRad(poses[1].cMo, *near) < angleRad(poses[0].cMo, *near)) best = 1;
  }
  last_pose_ = poses[best].cMo;
  return last_pose_;
}

}  // namespace servocal::procedure
