// SPDX-License-Identifier: GPL-3.0-or-later
// A simulated cell behind a controller in another process.
#include "servocal/sim_ur_cell/ur_cell.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <memory>

#include "cells.h"
#include "errors.h"
#include "motion_record.h"

namespace servocal::sim {
namespace {

CellConfig urCell() {
  CellConfig cell = test::oneCameraCell();
  cell.arm.backend = ArmBackend::kUr;
  cell.arm.ur = UrConfig{"127.0.0.1", "77"};
  return cell;
}

bool listens(int port) {
  const int descriptor = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const bool connected = ::connect(descriptor, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  ::close(descriptor);
  return connected;
}

TEST(UrCell, ItsControllerListensAsLongAsItLives) {
  WallClock clock;
  int port = 0;
  {
    UrCell cell(urCell(), 1, clock);
    port = cell.address().rtde_port;
    EXPECT_EQ(cell.address().serial, "77");
    EXPECT_TRUE(listens(port));
    EXPECT_THROW(cell.cell().arm(), std::invalid_argument);
    const auto frame =
        cell.cell().camera("cam1").next(Stream::kColor, clock.now() + std::chrono::seconds(10));
    ASSERT_TRUE(frame);
    EXPECT_LE(frame->stamp, clock.now());
  }
  EXPECT_FALSE(listens(port));
}

TEST(UrCell, HasAUr5AndASimulation) {
  WallClock clock;
  CellConfig other = urCell();
  other.arm.urdf = "panda.urdf";
  test::expectPart(test::messageOf(ErrorKind::kInvalidConfig, [&] { UrCell cell(other, 1, clock); }), "UR5");
  CellConfig real = urCell();
  real.simulation.reset();
  EXPECT_THROW(UrCell(real, 1, clock), std::invalid_argument);
}

/// A joint that turns by 1 rad/s, recorded every 8 ms from `from_s` of the run's clock on.
void fill(MotionRecord& record, const Clock& clock, double from_s, int steps) {
  const auto zero = std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()) -
                    clock.now().time_since_epoch();
  for (int i = 0; i < steps; ++i) {
    MotionStep step;
    const double at_s = from_s + 0.008 * i;
    step.steady_ns = (zero + fromSeconds(at_s)).count();
    step.q[0] = at_s;
    step.position_m[2] = 0.1 * at_s;
    step.travelled_rad = at_s - from_s;
    record.push(step);
  }
}

TEST(RecordedMotion, IsInterpolatedAndEndsAtItsEnds) {
  const WallClock clock;
  const auto record = std::make_unique<MotionRecord>();
  EXPECT_THROW(RecordedMotion(*record, clock), std::invalid_argument);
  fill(*record, clock, 1.0, 100);
  RecordedMotion motion(*record, clock);
  const ArmMoment moment = motion.at(Instant(fromSeconds(1.3456)));
  EXPECT_NEAR(moment.q[0], 1.3456, 1e-3);  // The clocks are compared to within that, on a busy computer.
  EXPECT_NEAR(moment.bMe.translation().z(), 0.13456, 1e-4);
  EXPECT_NEAR(moment.travelled_rad, moment.q[0] - 1.0, 1e-9);
  EXPECT_DOUBLE_EQ(motion.at(Instant(fromSeconds(0.2))).q[0], 1.0);
  EXPECT_DOUBLE_EQ(motion.at(Instant(fromSeconds(9.0))).q[0], 1.0 + 0.008 * 99);
}

TEST(RecordedMotion, GoesOnWhenItsMemoryIsFull) {
  const WallClock clock;
  const auto record = std::make_unique<MotionRecord>();
  const int steps = static_cast<int>(MotionRecord::kSteps) * 5 / 2;
  fill(*record, clock, 0.0, steps);
  RecordedMotion motion(*record, clock);
  const double last_s = 0.008 * (steps - 1);
  EXPECT_NEAR(motion.at(Instant(fromSeconds(last_s - 2.0))).q[0], last_s - 2.0, 1e-3);
  EXPECT_NEAR(motion.at(Instant(fromSeconds(last_s + 1.0))).q[0], last_s, 1e-12);
}

}  // namespace
}  // namespace servocal::sim
