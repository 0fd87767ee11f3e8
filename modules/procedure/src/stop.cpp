// SPDX-License-Identifier: GPL-3.0-or-later
#include "stop.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "servocal/board/depth.h"

namespace servocal::procedure {
namespace {

constexpr int kFrames = 3;
constexpr int kMinFrames = 2;
constexpr int kFramesTried = 6;
constexpr std::size_t kDepthFrames = 5;
constexpr double kStillPx = 0.5;  // median shift of the corners beyond their noise

/// The next frame of an eye that was exposed after `first`, with its detection.
std::optional<SeenFrame> seeAfter(Clock& clock, Eye& eye, Instant first) {
  const Instant deadline = clock.now() + std::chrono::milliseconds(900);  // Exclusive streams need to start.
  for (;;) {
    auto seen = eye.observer().see(deadline);
    if (!seen || seen->frame.stamp >= first) return seen;
  }
}

std::optional<sensor::Frame> depthAfter(Clock& clock, Eye& eye, Instant first) {
  const Instant deadline = clock.now() + std::chrono::milliseconds(300);
  for (;;) {
    auto frame = eye.device().next(Stream::kDepth, deadline);
    if (!frame || frame->stamp >= first) return frame;
  }
}

/// Mean of several detections of the same board, of the corners that most of them hold; the noise of a
/// corner is only partly independent from frame to frame (the pattern sits on the same pixels), so its
/// covariance is not divided by the count.
BoardDetection average(const std::vector<BoardDetection>& detections) {
  std::map<int, std::vector<const Corner*>> by_id;
  for (const BoardDetection& detection : detections) {
    for (const Corner& corner : detection.corners) by_id[corner.id].push_back(&corner);
  }
  BoardDetection mean;
  mean.orientation_known = true;
  for (const auto& [id, seen] : by_id) {
    if (2 * seen.size() <= detections.size()) continue;
    Corner corner{id, Eigen::Vector2d::Zero(), Eigen::Matrix2d::Zero()};
    for (const Corner* one : seen) {
      corner.pixel += one->pixel;
      corner.covariance_px2 += one->covariance_px2;
    }
    const auto count = static_cast<double>(seen.size());
    corner.pixel /= count;
    corner.covariance_px2 /= count * std::sqrt(count);
    mean.corners.push_back(corner);
  }
  return mean;
}

/// Median shift of the corners that both hold, beyond their noise, px; nothing if there are none.
std::optional<double> motionBeyondNoise(const BoardDetection& before, const BoardDetection& after) {
  std::vector<double> beyond_noise_px;
  auto later = after.corners.begin();
  for (const Corner& corner : before.corners) {
    while (later != after.corners.end() && later->id < corner.id) ++later;
    if (later == after.corners.end()) break;
    if (later->id != corner.id) continue;
    const double noise_px = std::sqrt((corner.covariance_px2 + later->covariance_px2).trace());
    beyond_noise_px.push_back((corner.pixel - later->pixel).norm() - noise_px);
  }
  if (beyond_noise_px.empty()) return std::nullopt;
  const auto middle = beyond_noise_px.begin() + static_cast<std::ptrdiff_t>(beyond_noise_px.size() / 2);
  std::nth_element(beyond_noise_px.begin(), middle, beyond_noise_px.end());
  return *middle;
}

/// Light that comes back weakly reads farther (time of flight): black print by a millimetre and more. The correction is
/// that of white paper.
board::BoardDepthOptions depthOptions(DepthSensor sensor) {
  board::BoardDepthOptions options;
  if (sensor != DepthSensor::kTimeOfFlight) return options;
  options.white_only = true;
  options.min_patch_pixels = 5;
  return options;
}

}  // namespace

std::vector<StopView> gatherStop(Clock& clock, const std::vector<Eye*>& eyes, Instant rest, bool first_is_wanted) {
  std::vector<StopView> views;
  for (Eye* eye : eyes) {
    views.emplace_back();
    views.back().eye = eye;
  }
  std::vector<bool> gone(views.size(), false);
  for (int round = 1; round <= kFramesTried; ++round) {
    bool more = false;
    for (std::size_t i = 0; i < views.size(); ++i) {
      StopView& view = views[i];
      if (gone[i]) continue;
      // An exposure lasts a frame period at most, so these frames began after the arm came to rest.
      const Instant first = rest + fromSeconds(0.5 / view.eye->rateHz());
      if (view.detections.size() < kFrames) {
        auto seen = seeAfter(clock, *view.eye, first);
        if (seen && seen->detection && view.eye->observer().isUsable(*seen->detection)) {
          view.detections.push_back(*seen->detection);
          view.last_stamp = seen->frame.stamp;
          if (!view.first_frame) view.first_frame = std::move(seen->frame);
        } else {
          const int missed = round - static_cast<int>(view.detections.size());
          const bool patient = first_is_wanted && i == 0;
          gone[i] = !seen || missed > (patient ? kFramesTried - kMinFrames : 0);
          if (gone[i] && patient && static_cast<int>(view.detections.size()) < kMinFrames) return {};
        }
      }
      if (gone[i]) continue;
      if (view.eye->hasDepth() && view.depth.size() < kDepthFrames) {
        if (auto frame = depthAfter(clock, *view.eye, first)) view.depth.push_back(std::move(*frame));
      }
      more = more || view.detections.size() < kFrames || (view.eye->hasDepth() && view.depth.size() < kDepthFrames);
    }
    if (!more) break;
  }
  const auto tooFew = [](const StopView& view) { return static_cast<int>(view.detections.size()) < kMinFrames; };
  if (first_is_wanted && tooFew(views.front())) return {};
  views.erase(std::remove_if(views.begin(), views.end(), tooFew), views.end());
  return views;
}

bool isStill(const StopView& view) {
  // Every frame, not just the last: what sways may be back where it was.
  const BoardDetection& first = view.detections.front();
  return std::all_of(view.detections.begin() + 1, view.detections.end(), [&](const BoardDetection& later) {
    const auto moved_px = motionBeyondNoise(first, later);
    return moved_px && *moved_px < kStillPx;
  });
}

StreamObservation toObservation(const StopView& stop, const BoardSpec& board) {
  StreamObservation view;
  view.camera = stop.eye->camera();
  view.stream = stop.eye->stream();
  view.stamp = stop.first_frame->stamp;
  view.device_stamp_s = stop.first_frame->device_stamp_s;
  view.width_px = stop.first_frame->image.cols;
  view.height_px = stop.first_frame->image.rows;
  view.detection = average(stop.detections);
  if (!stop.depth.empty()) {
    std::vector<cv::Mat> frames;
    for (const sensor::Frame& frame : stop.depth) frames.push_back(frame.image);
    auto measured = board::measureBoardDepth(frames, view.detection, board, stop.eye->model(),
                                             depthOptions(stop.eye->depthSensor()));
    view.depth = std::move(measured.depth);
    stop.eye->noteDepth(view.depth ? "" : measured.reason);
  }
  return view;
}

}  // namespace servocal::procedure
