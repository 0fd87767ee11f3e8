// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/clock.h"

#include <gtest/gtest.h>

namespace servocal {
namespace {

using namespace std::chrono_literals;

TEST(SimulatedClock, PassesOnlyWhenSomebodySleeps) {
  SimulatedClock clock;
  EXPECT_EQ(clock.now(), Instant{});
  EXPECT_EQ(clock.now(), Instant{});
  clock.sleepFor(250ms);
  EXPECT_EQ(clock.now(), Instant{} + 250ms);
  clock.sleepUntil(Instant{} + 1s);
  EXPECT_EQ(clock.now(), Instant{} + 1s);
}

TEST(SimulatedClock, NeverRunsBackwards) {
  SimulatedClock clock;
  clock.sleepUntil(Instant{} + 1s);
  clock.sleepUntil(Instant{} + 500ms);
  clock.sleepFor(-2s);
  EXPECT_EQ(clock.now(), Instant{} + 1s);
}

// A thousand steps of a thirtieth of a second do not drift: time is counted in nanoseconds.
TEST(SimulatedClock, DoesNotDrift) {
  SimulatedClock clock;
  const Duration step = fromSeconds(1.0 / 30.0);
  for (int i = 0; i < 3000; ++i) clock.sleepFor(step);
  EXPECT_EQ(clock.now() - Instant{}, 3000 * step);
  EXPECT_NEAR(toSeconds(clock.now()), 100.0, 3000 * 1e-9);
}

TEST(WallClock, StartsAtZeroAndSleepsAtLeastAsLongAsAsked) {
  WallClock clock;
  EXPECT_LT(clock.now(), Instant{} + 10s);
  const Instant before = clock.now();
  clock.sleepUntil(before + 20ms);
  EXPECT_GE(clock.now(), before + 20ms);
  clock.sleepUntil(before);  // has passed
  EXPECT_GE(clock.now(), before + 20ms);
}

TEST(Duration, ConvertsToSeconds) {
  EXPECT_EQ(toSeconds(1500ms), 1.5);
  EXPECT_EQ(fromSeconds(0.25), 250ms);
  EXPECT_EQ(toSeconds(Instant{} + 2s), 2.0);
}

}  // namespace
}  // namespace servocal
