// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/depth_model.h"

#include <gtest/gtest.h>

#include <cmath>

namespace servocal {
namespace {

DepthModel model(DepthSensor sensor) {
  DepthModel depth;
  depth.sensor = sensor;
  depth.camera = CameraModel::fromFieldOfView(101, 81, 1.0);
  depth.nodes_x = 3;
  depth.nodes_y = 2;
  depth.nodes.resize(6);
  depth.nodes << 1, 2, 4, 10, 20, 40;
  depth.nodes *= 1e-3;
  return depth;
}

TEST(DepthModel, LatticeIsBilinearBetweenFirstAndLastPixel) {
  const DepthModel depth = model(DepthSensor::kTimeOfFlight);
  EXPECT_DOUBLE_EQ(depth.lattice({0, 0}), 0.001);
  EXPECT_DOUBLE_EQ(depth.lattice({100, 80}), 0.040);
  EXPECT_DOUBLE_EQ(depth.lattice({50, 0}), 0.002);
  EXPECT_NEAR(depth.lattice({25, 40}), 0.25 * (0.001 + 0.002 + 0.010 + 0.020), 1e-15);
  EXPECT_DOUBLE_EQ(depth.lattice({-7, 500}), 0.010);
}

TEST(DepthModel, StructuredLightCorrectsInverseDepth) {
  DepthModel depth = model(DepthSensor::kStructuredLight);
  depth.offset = 0.02;
  depth.slope = 0.99;
  EXPECT_NEAR(*depth.correct({0, 0}, 0.8), 1.0 / (0.02 + 0.99 / 0.8 + 0.001), 1e-15);
}

TEST(DepthModel, TimeOfFlightCorrectsRange) {
  DepthModel depth = model(DepthSensor::kTimeOfFlight);
  depth.offset = -0.03;
  depth.slope = 1.01;
  // Its corner: half the width over the focal length each way.
  const double x = 50.0 / depth.camera.fx(), y = 40.0 / depth.camera.fy();
  const double stretch = std::sqrt(1.0 + x * x + y * y);
  EXPECT_NEAR(*depth.correct({0, 0}, 0.8), (-0.03 + 1.01 * 0.8 * stretch + 0.001) / stretch, 1e-12);
}

TEST(DepthModel, WigglingIsLinearBetweenItsNodesAndConstantBeyond) {
  DepthModel depth = model(DepthSensor::kTimeOfFlight);
  EXPECT_EQ(depth.wiggling(0.8), 0.0);
  const double without = depth.correct({0, 0}, 0.6).value();
  depth.wiggle = Eigen::Vector3d(0.001, 0.003, -0.001);
  depth.wiggle_from_m = 0.5;
  depth.wiggle_to_m = 0.9;
  EXPECT_DOUBLE_EQ(depth.wiggling(0.3), 0.001);
  EXPECT_NEAR(depth.wiggling(0.6), 0.002, 1e-15);
  EXPECT_NEAR(depth.wiggling(0.85), 0.0, 1e-15);
  EXPECT_DOUBLE_EQ(depth.wiggling(2.0), -0.001);
  const double x = 50.0 / depth.camera.fx(), y = 40.0 / depth.camera.fy();
  const double stretch = std::sqrt(1.0 + x * x + y * y);
  EXPECT_NEAR(depth.correct({0, 0}, 0.6).value() - without, depth.wiggling(0.6 * stretch) / stretch, 1e-12);
}

TEST(DepthModel, NoDepthGivesNone) {
  DepthModel depth = model(DepthSensor::kStructuredLight);
  EXPECT_FALSE(depth.correct({10, 10}, 0.0));
  EXPECT_FALSE(depth.correct({10, 10}, -1.0));
  EXPECT_FALSE(depth.correct({10, 10}, NAN));
  depth.offset = -3.0;  // beyond infinity
  EXPECT_FALSE(depth.correct({10, 10}, 0.8));
}

}  // namespace
}  // namespace servocal
