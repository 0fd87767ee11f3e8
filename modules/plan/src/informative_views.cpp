// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/plan/informative_views.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "servocal/core/mount.h"
#include "way.h"

namespace servocal::plan {
namespace {

constexpr double kServoShare = 1.3;    // a servo converges; a straight motion at the limits would not
constexpr int kDrawsPerCandidate = 4;  // at most
constexpr int kPushes = 5;             // of a drawn pose into the image

struct Candidate {
  InformativeView view;
  double floor = 0.0;  // what the floors lack and it brings
};

/// Element `index` of the van der Corput sequence in this base: 0 to 1.
double radicalInverse(int index, int base) {
  double value = 0.0, share = 1.0;
  for (; index > 0; index /= base) {
    share /= base;
    value += share * (index % base);
  }
  return value;
}

Pose<Base, EndEffector> flangeFor(const Belief& belief, const Pose<Color, Board>& cMo) {
  return forMount(belief.mount, belief.bMc * cMo * belief.eMo.inverse());
}

Pose<Color, Board> boardAt(const Belief& belief, const Pose<Base, EndEffector>& bMe) {
  return belief.bMc.inverse() * forMount(belief.mount, bMe) * belief.eMo;
}

/// Board pose number `index` before a camera. One that would reach out of the image is pushed in, so that
/// many touch the border: that is where a lens is known worst. Nothing if it does not fit in.
std::optional<Pose<Color, Board>> drawPose(const CameraModel& camera,
                                           const std::vector<Eigen::Vector3d>& outline, int index,
                                           double margin_px, const InformativeOptions& options) {
  using Eigen::AngleAxisd;
  using Eigen::Vector3d;
  const double distance_m = options.near_m + radicalInverse(index, 5) * (options.far_m - options.near_m);
  const double towards = 2.0 * M_PI * radicalInverse(index, 7);
  const double tilt = options.max_tilt_rad * std::sqrt(radicalInverse(index, 11));
  const double roll = options.max_roll_rad * (2.0 * radicalInverse(index, 13) - 1.0);
  const Eigen::Matrix3d turned = (AngleAxisd(tilt, Vector3d(std::cos(towards), std::sin(towards), 0.0)) *
                                  AngleAxisd(roll, Vector3d::UnitZ()))
                                     .toRotationMatrix();
  const Eigen::Vector2d least = Eigen::Vector2d::Constant(margin_px),
                        most(camera.width_px - 1 - margin_px, camera.height_px - 1 - margin_px);
  Eigen::Vector2d middle(radicalInverse(index, 2) * (camera.width_px - 1),
                         radicalInverse(index, 3) * (camera.height_px - 1));
  for (int push = 0; push < kPushes; ++push) {
    const auto ray = camera.unproject(middle);
    if (!ray) return std::nullopt;
    const Pose<Color, Board> cMo(turned, distance_m * ray->homogeneous());
    Eigen::Vector2d low = most, high = least;
    for (const Eigen::Vector3d& point : outline) {
      const auto pixel = camera.project(cMo * point);
      if (!pixel) return std::nullopt;
      low = low.cwiseMin(*pixel);
      high = high.cwiseMax(*pixel);
    }
    const Eigen::Vector2d out = (least - low).cwiseMax(0.0) - (high - most).cwiseMax(0.0);
    if (out.norm() == 0.0) return cMo;
    middle += 1.05 * out;  // The lens bends: a little further.
  }
  return std::nullopt;
}

/// What a floor lacks, if a viewer has one.
class Lacking {
 public:
  explicit Lacking(const coverage::Coverage* floor) : floor_(floor) {
    if (floor != nullptr) open_ = floor->openCells();
  }
  /// What the stop brings of it.
  double share(const std::vector<Eigen::Vector2d>& pixels, const Pose<Color, Board>& cMo) const {
    if (floor_ == nullptr) return 0.0;
    double share = floor_->missingMarginals(cMo);
    if (open_.empty()) return share;
    std::vector<int> in_cell(static_cast<std::size_t>(floor_->cells()), 0);
    for (const Eigen::Vector2d& pixel : pixels) {
      if (const auto cell = floor_->cellAt(pixel)) ++in_cell[static_cast<std::size_t>(*cell)];
    }
    for (const int cell : open_) {
      share += std::min(
          1.0, static_cast<double>(in_cell[static_cast<std::size_t>(cell)]) / floor_->missingToFill(cell));
    }
    return share;
  }

 private:
  const coverage::Coverage* floor_;
  std::vector<int> open_;
};

/// The candidate seen by all who see it; nothing if the one it is meant for does not.
std::optional<Candidate> candidateOf(const std::vector<Viewer>& viewers, const std::vector<Lacking>& lacking,
                                     std::size_t meant_for, const Pose<Color, Board>& cdMo,
                                     const BoardPoints& board, const InformativeOptions& options) {
  const Viewer& wanted = viewers[meant_for];
  Candidate candidate;
  candidate.view.viewer = meant_for;
  candidate.view.cdMo = cdMo;
  candidate.view.bMe = candidate.view.stop.bMe = flangeFor(wanted.belief, cdMo);
  for (std::size_t i = 0; i < viewers.size(); ++i) {
    const Viewer& viewer = viewers[i];
    if (i != meant_for && !viewer.looks_on && viewer.device != wanted.device) continue;
    const Pose<Color, Board> cMo = i == meant_for ? cdMo : boardAt(viewer.belief, candidate.view.bMe);
    const bool faces = cMo.translation().z() > 0.0 && cMo.rotation().col(2).dot(cMo.translation()) > 0.0;
    const double probability = faces ? viewer.detectability.probability(cMo) : 0.0;
    const auto pixels = probability >= options.least_probability
                            ? visibleCorners(cMo, viewer.belief.camera, board, viewer.image_margin_px)
                            : std::nullopt;
    if (!pixels) {
      if (i == meant_for) return std::nullopt;
      continue;
    }
    candidate.view.stop.looks.push_back({viewer.camera, probability});
    candidate.floor += probability * lacking[i].share(*pixels, cMo);
  }
  return candidate;
}

std::vector<Candidate> draw(const std::vector<Viewer>& viewers, const BoardSpec& board,
                            const InformativeOptions& options) {
  const BoardPoints points(board);
  std::vector<Candidate> candidates;
  std::vector<std::size_t> wanted;
  std::vector<Lacking> lacking;
  for (std::size_t i = 0; i < viewers.size(); ++i) {
    lacking.emplace_back(viewers[i].floor);
    if (viewers[i].wanted) wanted.push_back(i);
  }
  const int draws = kDrawsPerCandidate * options.candidates;
  for (int i = 0; i < draws && static_cast<int>(candidates.size()) < options.candidates && !wanted.empty();
       ++i) {
    const std::size_t meant_for = wanted[static_cast<std::size_t>(i) % wanted.size()];
    // Every viewer has all of the sequence: its elements alternate. The first of them are on lines.
    const int index = 20 + options.draw * draws + i / static_cast<int>(wanted.size());
    const auto cdMo = drawPose(viewers[meant_for].belief.camera, points.outline, index,
                               viewers[meant_for].image_margin_px, options);
    if (!cdMo || isTried(viewers[meant_for].tried, *cdMo)) continue;
    if (auto candidate = candidateOf(viewers, lacking, meant_for, *cdMo, points, options)) {
      candidates.push_back(*std::move(candidate));
    }
  }
  return candidates;
}

/// What each is worth: what it tells, and what it brings of the floors.
std::vector<double> worthOf(const std::vector<Candidate>& candidates, const calib::Forecast& forecast,
                            double floor_worth) {
  std::vector<calib::PlannedStop> stops;
  for (const Candidate& candidate : candidates) stops.push_back(candidate.view.stop);
  std::vector<double> worth = forecast.gains(stops);
  for (std::size_t i = 0; i < worth.size(); ++i) worth[i] += floor_worth * candidates[i].floor;
  return worth;
}

}  // namespace

std::optional<InformativeView> informativeView(const calib::Forecast& forecast, const std::vector<Viewer>& viewers,
                                               const BoardSpec& board, const robot::Guard& guard,
                                               const Eigen::VectorXd& current_q, const InformativeOptions& options) {
  if (viewers.empty()) return std::nullopt;
  std::vector<Candidate> candidates = draw(viewers, board, options);
  const std::vector<double> worth = worthOf(candidates, forecast, options.floor_worth);
  const auto bMe_from = guard.kinematics().forward(current_q);
  std::vector<std::pair<double, std::size_t>> by_utility;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (worth[i] < options.least_worth) continue;
    const double time_s = options.stop_time_s +
                          kServoShare * travelTimeS(bMe_from, candidates[i].view.bMe, guard.limits());
    by_utility.emplace_back(worth[i] / time_s, i);
  }
  std::sort(by_utility.begin(), by_utility.end(), std::greater<>());
  for (const auto& [utility, i] : by_utility) {
    InformativeView& view = candidates[i].view;
    if (!guard.allows(view.bMe)) continue;  // Known sooner than that no joint angles lead there.
    const auto q = guard.kinematics().inverse(view.bMe, current_q, guard.limits().joint_margin_rad);
    if (!q || !guard.allows(*q)) continue;
    view.straight = straightWayFree(guard, current_q, view.bMe, options.min_singular_value);
    return std::move(view);
  }
  return std::nullopt;
}

}  // namespace servocal::plan
