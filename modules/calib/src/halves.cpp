// SPDX-License-Identifier: GPL-3.0-or-later
// Two independent halves of the stops, compared.
#include <algorithm>
#include <cmath>
#include <set>

#include "map_rows.h"
#include "median.h"
#include "servocal/calib/uncertainty.h"

namespace servocal::calib {
namespace {

constexpr int kCells = 9;

const JointCamera* sameStream(const JointSolution& solution, const JointCamera& camera) {
  for (const JointCamera& other : solution.cameras) {
    if (other.camera == camera.camera && other.stream == camera.stream) return &other;
  }
  return nullptr;
}

/// Median distance of the board at the stops that the camera used; nothing if there are none.
std::optional<double> rangeM(const std::vector<Observation>& observations, const JointSolution& solution,
                             const JointCamera& camera) {
  std::set<std::int64_t> used;
  for (const ViewResidual& view : camera.views) {
    if (view.used) used.insert(view.observation_id);
  }
  std::vector<double> ranges_m;
  for (const Observation& observation : observations) {
    if (!observation.robot || used.count(observation.id) == 0) continue;
    const Eigen::Isometry3d& bMe = observation.robot->bMe.isometry();
    const Eigen::Isometry3d lMr = solution.mount == Mount::kFixed ? bMe : bMe.inverse();
    ranges_m.push_back((camera.pose.inverse() * lMr * solution.board_pose.translation()).norm());
  }
  if (ranges_m.empty()) return std::nullopt;
  return median(std::move(ranges_m));
}

std::optional<JointHalves> compare(const JointSolution& first, const JointCamera& by_first,
                                   const JointSolution& second, const JointCamera& by_second,
                                   const JointCamera& both, double range_m) {
  JointHalves out;
  int points = 0;
  for (const auto& seen : grid(both, kCells, kCells, range_m)) {
    if (!seen) continue;
    const Eigen::Vector3d point_l = both.pose * seen->point_c;
    const auto one = by_first.model.project(by_first.pose.inverse() * point_l);
    const auto other = by_second.model.project(by_second.pose.inverse() * point_l);
    if (!one || !other) continue;
    out.rms_px += 0.5 * (*one - *other).squaredNorm();  // per axis, as the maps' RMS
    ++points;
  }
  if (points == 0) return std::nullopt;
  out.rms_px = std::sqrt(out.rms_px / points);
  out.claimed_px = std::hypot(projectionMap(first, by_first, Anchor::kBase, range_m).rms_px,
                              projectionMap(second, by_second, Anchor::kBase, range_m).rms_px);
  if (!std::isfinite(out.claimed_px)) return std::nullopt;
  return out;
}

}  // namespace

std::vector<std::optional<JointHalves>> compareHalves(const BoardSpec& board,
                                                      const std::vector<Observation>& observations,
                                                      const JointOptions& options,
                                                      const JointSolution& solution) {
  std::vector<Observation> sorted = observations;
  std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  std::vector<Observation> halves[2];
  int stop = 0;
  for (Observation& observation : sorted) {
    if (observation.robot && !observation.views.empty()) halves[stop++ % 2].push_back(std::move(observation));
  }
  std::vector<std::optional<JointHalves>> out(solution.cameras.size());
  const JointOutcome first = solveJoint(board, halves[0], options),
                     second = solveJoint(board, halves[1], options);
  if (!first.solution || !second.solution) return out;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const JointCamera& camera = solution.cameras[i];
    const JointCamera *by_first = sameStream(*first.solution, camera),
                      *by_second = sameStream(*second.solution, camera);
    const auto range_m = rangeM(observations, solution, camera);
    if (by_first == nullptr || by_second == nullptr || !range_m) continue;
    out[i] = compare(*first.solution, *by_first, *second.solution, *by_second, camera, *range_m);
  }
  return out;
}

}  // namespace servocal::calib
