// SPDX-License-Identifier: GPL-3.0-or-later
// Moves the simulated arm up until somebody ends it; for kill_test.cpp.
// usage: ur_endless_motion RTDE_PORT DASHBOARD_PORT PROGRAM_PORT WATCHDOG_S
#include <sys/prctl.h>

#include <csignal>
#include <cstdlib>

#include "motion_key.h"
#include "servocal/core/cell_config.h"
#include "servocal/robot_ur/arm.h"

int main(int argc, char** argv) {
  using namespace servocal;
  if (argc != 5) return 2;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  WallClock clock;
  ArmConfig config;
  config.ur = UrConfig{"127.0.0.1", "2014350123", std::atoi(argv[1]), std::atoi(argv[2]), std::atoi(argv[3])};
  robot::ur::ArmOptions options;
  options.watchdog = fromSeconds(std::atof(argv[4]));
  options.dead_peer = std::chrono::milliseconds(500);
  try {
    robot::ur::Arm arm(config, defaultCell().limits, clock, options);
    arm.arm("2014350123");
    while (clock.now() < Instant(std::chrono::seconds(60))) {
      arm.move(test::forgedMotionKey(), {{0.0, 0.0, 0.05}, Eigen::Vector3d::Zero()},
               std::chrono::milliseconds(100));
      clock.sleepFor(std::chrono::milliseconds(8));
    }
  } catch (const Error&) {
    return 1;
  }
}
