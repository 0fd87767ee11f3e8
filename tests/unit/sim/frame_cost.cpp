// SPDX-License-Identifier: GPL-3.0-or-later
// Prints the CPU time of a simulated 1080p frame of the default cell: at rest and moving, with the board
// near and far. Run it by hand.
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <vector>

#include "default_sim.h"
#include "motion_key.h"
#include "sim_truth.h"

namespace {

using namespace servocal;

double cpuMs() { return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

double boardShare(const std::vector<Eigen::Vector2d>& corners) {  // Corners of 5 x 3 of 8 x 6 squares.
  const Eigen::Vector2d right = corners[5] - corners[0], down = corners[18] - corners[0];
  const double grid_px2 = std::abs(right.x() * down.y() - right.y() * down.x());
  return grid_px2 * (8.0 * 6.0) / (5.0 * 3.0) / (1920.0 * 1080.0);
}

void report(sim::Cell& cell, const char* name, const Twist<Base>& twist, int frames) {
  const sim::Truth truth(cell);
  std::vector<double> costs;
  sensor::Frame frame;
  for (int i = 0; i < frames; ++i) {
    cell.arm().move(test::forgedMotionKey(), twist, std::chrono::milliseconds(100));
    const double before = cpuMs();
    frame = cell.camera("front").next(Stream::kColor, cell.clock().now() + std::chrono::seconds(1)).value();
    costs.push_back(cpuMs() - before);
  }
  std::sort(costs.begin(), costs.end());
  std::printf("%-24s board %4.1f %% of the image: median %.2f ms, best %.2f ms\n", name,
              100.0 * boardShare(truth.corners("front", frame.stamp)), costs[costs.size() / 2], costs[0]);
}

}  // namespace

int main() {
  sim::Cell cell(test::defaultSimCell(), 1);
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const double before = cpuMs();
  cell.camera("front").next(Stream::kColor, cell.clock().now() + std::chrono::seconds(1));
  std::printf("first frame, tables included: %.0f ms\n", cpuMs() - before);
  report(cell, "at rest", {}, 60);
  report(cell, "sideways 0.15 m/s", {{0.0, 0.15, 0.0}, none}, 30);
  report(cell, "back 0.15 m/s", {{0.0, -0.15, 0.0}, none}, 30);
  report(cell, "nearer 0.15 m/s", {{0.15, 0.0, 0.0}, none}, 32);
  report(cell, "at rest, near", {}, 60);
  report(cell, "sideways 0.1 m/s, near", {{0.0, 0.1, 0.0}, none}, 30);
  return 0;
}
