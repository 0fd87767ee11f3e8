// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app_cameras/cameras.h"

#include <gtest/gtest.h>

#include "default_sim.h"
#include "errors.h"

namespace servocal::app {
namespace {

TEST(Cameras, DriversOfRealCamerasAreRefusedInASimulatedCell) {
  for (const auto& [backend, name] :
       {std::pair(CameraBackend::kFreenect, "'freenect'"), std::pair(CameraBackend::kV4l2, "'v4l2'")}) {
    CellConfig config = test::defaultSimCell();
    sim::Cell cell(config, 1);
    config.cameras[0].backend = backend;
    const std::string refusal = test::messageOf(ErrorKind::kInvalidConfig,
                                                [&] { const Cameras cameras(config, cell.clock(), &cell); });
    test::expectPart(refusal, name);
    test::expectPart(refusal, "'sim' or 'openni2'");
  }
}

TEST(Cameras, EachIsLookedForByItsOwnDriver) {
  CellConfig config = test::kinectSimCell(DepthSensor::kStructuredLight);
  config.cameras[0].backend = CameraBackend::kFreenect;
  config.cameras[0].device = "A00000000000000A";
  WallClock clock;
  test::expectPart(
      test::messageOf(ErrorKind::kHardwareAbsent, [&] { const Cameras cameras(config, clock, nullptr); }),
      "freenect");
  config.cameras[0].backend = CameraBackend::kSim;
  test::expectPart(
      test::messageOf(ErrorKind::kInvalidConfig, [&] { const Cameras cameras(config, clock, nullptr); }),
      "needs a simulated arm");
}

}  // namespace
}  // namespace servocal::app
