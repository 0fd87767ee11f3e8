// SPDX-License-Identifier: GPL-3.0-or-later
// The depth correction stands on the joint estimate.
#include <gtest/gtest.h>

#include "depth_scene.h"
#include "joint_scene.h"
#include "servocal/procedure/solve.h"

namespace servocal::procedure {
namespace {

struct Recorded {
  test::Cell cell = test::makeCell(3);
  DepthModel truth = test::timeOfFlight();
  std::vector<Observation> observations;
};

/// Few stops of an arm that is good to 0.1 mm, each with the depth of the board.
Recorded record(std::uint64_t seed) {
  Recorded out;
  out.truth.camera = out.cell.cameras[1].model;
  std::mt19937_64 random(seed);
  const auto stops = test::randomStops(out.cell, 30, random);
  out.observations = test::observeAll(out.cell, stops, {0.2, 1e-4, 2.5e-4}, random);
  for (std::size_t i = 0; i < stops.size(); ++i) {
    for (StreamObservation& seen : out.observations[i].views) {
      if (seen.stream != Stream::kInfrared) continue;
      const Pose<Color, Board> cMo(test::trueBoardInCamera(out.cell, out.cell.cameras[1], stops[i].bMe));
      seen.depth = test::patchesOf(out.truth, out.cell.board, cMo, {0.0, 3e-4, 0.0}, random);
    }
  }
  return out;
}

SolveOptions options() {
  SolveOptions out;
  out.robot_sigma_m = 1e-4;
  out.robot_sigma_rad = 2.5e-4;
  out.depth_sensors = {{"k1", DepthSensor::kTimeOfFlight}};
  return out;
}

double errorM(const Recorded& recorded, const DepthModel& model) {
  return test::correctionError(model, recorded.truth, 0.5, 0.7);
}

TEST(SolveDepthOfACell, StandsOnTheJointEstimate) {
  double squares_m2 = 0.0, squares_z = 0.0;
  constexpr int kSeeds = 6;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const Recorded recorded = record(seed);
    const CalibrationResult result = solve(recorded.cell.board, recorded.observations, options());
    ASSERT_TRUE(result.joint) << result.joint_problem;
    const CameraResult& camera = result.cameras.front();
    ASSERT_TRUE(camera.depth);
    EXPECT_EQ(camera.depth->model.camera.parameters, camera.infrared->camera.parameters);
    const double error_m = errorM(recorded, camera.depth->model);
    std::cout << "seed " << seed << ": " << 1e3 * error_m << " mm, claimed " << 1e3 * camera.depth->sigma_m[1] << '\n';
    squares_m2 += error_m * error_m / kSeeds;
    squares_z += std::pow(error_m / camera.depth->sigma_m[1], 2) / kSeeds;
  }
  EXPECT_LT(std::sqrt(squares_m2), 1e-3);  // In stages: 2.7 mm.
  EXPECT_LT(std::sqrt(squares_z), 2.0);
}

}  // namespace
}  // namespace servocal::procedure
