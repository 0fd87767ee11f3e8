// SPDX-License-Identifier: GPL-3.0-or-later
#include "reachable_cells.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>

#include "default_sim.h"
#include "ur5.h"

namespace servocal::test {
namespace {

constexpr const char* kCamera = "front";

ReachableCells reachable(const CellConfig& config, std::uint64_t seed) {
  sim::Cell cell(config, seed);
  return reachableCells(config, sim::Truth(cell), kCamera);
}

TEST(ReachableCells, DefaultCellCanBeFilled) {
  const CellConfig config = defaultSimCell();
  double least = 1.0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    least = std::min(least, reachable(config, seed).fraction());
  }
  std::cout << "least reachable share of image cells over 20 seeds: " << least << '\n';
  EXPECT_GE(least, 0.85);
}

// Whatever is handed out as reachable is checked again, by other means where there are some.
TEST(ReachableCells, WitnessesHold) {
  const CellConfig config = defaultSimCell();
  sim::Cell cell(config, 3);
  const sim::Truth truth(cell);
  const ReachableCells result = reachableCells(config, truth, kCamera);
  const CameraModel model = truth.camera(kCamera);
  for (int row = 0; row < result.cells_y; ++row) {
    for (int column = 0; column < result.cells_x; ++column) {
      const auto& view = result.cells[row * result.cells_x + column];
      if (!view) continue;
      const Pose<Base, EndEffector> bMe(sim::Ur5().forward(view->q));
      const Pose<Base, Board> by_arm = bMe * truth.eMo(), by_camera = truth.bMc(kCamera) * view->cMo;
      EXPECT_LT(distanceM(by_arm, by_camera), 5e-4);
      EXPECT_LT(angleRad(by_arm, by_camera), 5e-4);
      EXPECT_LE(view->q.cwiseAbs().maxCoeff(), 2 * M_PI - config.limits.joint_margin_rad);
      EXPECT_TRUE(config.limits.workspace.contains(bMe.translation()));
      int inside = 0;
      for (const Eigen::Vector3d& corner : config.board.corners()) {
        const auto pixel = model.project(view->cMo * corner);
        ASSERT_TRUE(pixel && model.contains(*pixel));
        inside += pixel->x() > column * 240 - 0.5 && pixel->x() < (column + 1) * 240 - 0.5 &&
                  pixel->y() > row * 216 - 0.5 && pixel->y() < (row + 1) * 216 - 0.5;
        const Eigen::Vector3d point_b = by_arm * corner;
        EXPECT_TRUE(config.limits.workspace.contains(point_b));
        for (const Box& box : config.limits.keep_out) EXPECT_FALSE(box.contains(point_b));
      }
      EXPECT_GE(inside, config.coverage.corners_per_cell);
    }
  }
}

// The board is wholly in view at the start and not tilted too far, whatever the seed.
TEST(ReachableCells, StartSeesTheBoardForEverySeed) {
  const CellConfig config = defaultSimCell();
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    sim::Cell cell(config, seed);
    const sim::Truth truth(cell);
    const Instant now = cell.clock().now();
    for (const Eigen::Vector2d& pixel : truth.corners(kCamera, now)) {
      EXPECT_TRUE(truth.camera(kCamera).contains(pixel, 100.0)) << "seed " << seed;
    }
    const Pose<Color, Board> cMo = truth.cMo(kCamera, now);
    EXPECT_LT(std::acos(cMo.rotation()(2, 2)), 40.0 * M_PI / 180.0) << "seed " << seed;
  }
}

// Negative controls: out of the arm's reach, below the table, or forbidden, nothing is reachable.
TEST(ReachableCells, SaysNoWhereTheArmCannotGo) {
  CellConfig far = defaultSimCell();
  far.simulation->cameras[0].position_m = {3.0, 0.0, 0.4};
  EXPECT_EQ(reachable(far, 1).count(), 0);

  CellConfig table = defaultSimCell();
  table.limits.workspace.min_m.z() = 0.45;
  const ReachableCells upper = reachable(table, 1);
  EXPECT_GT(upper.count(), 5);
  EXPECT_LT(upper.count(), 25);
  for (int column = 0; column < 8; ++column) EXPECT_FALSE(upper.reachable(column, 4));

  CellConfig forbidden = defaultSimCell();
  forbidden.limits.keep_out.push_back({"all", {-2, -2, -2}, {2, 2, 2}});
  EXPECT_EQ(reachable(forbidden, 1).count(), 0);
}

}  // namespace
}  // namespace servocal::test
