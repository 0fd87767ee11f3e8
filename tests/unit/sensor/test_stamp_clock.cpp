// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "servocal/sensor/stamp_clock.h"

namespace servocal::sensor {
namespace {

// A device at 30 Hz whose clock starts anywhere and drifts; transport is never faster than the nominal
// latency.
struct Device {
  double start_s = 1234.5;
  double drift_ppm = 0.0;
  double wrap_s = 0.0;
  std::mt19937_64 random{3};
  double true_s = 0.0;

  StampClock::Reading next(StampClock& clock, double delay_s = 0.0, double step_s = 0.0) {
    true_s += 1.0 / 30.0;
    start_s += step_s;
    // Now and then a frame comes through at once.
    const double jitter_s = std::max(0.0, std::uniform_real_distribution<double>(-0.004, 0.02)(random));
    double device_s = start_s + true_s * (1.0 + 1e-6 * drift_ppm);
    if (wrap_s > 0.0) device_s = std::fmod(device_s, wrap_s);
    return clock.read(device_s, Instant(fromSeconds(true_s + 0.065 + jitter_s + delay_s)));
  }
  double errorS(const StampClock::Reading& reading) const { return toSeconds(reading.stamp) - true_s; }
};

TEST(StampClock, FindsTheOffsetThroughJitterAndFollowsDrift) {
  for (const double drift_ppm : {-100.0, 0.0, 100.0}) {
    SCOPED_TRACE(drift_ppm);
    StampClock clock;
    Device device;
    device.drift_ppm = drift_ppm;
    double largest = 0.0;
    for (int i = 0; i < 30000; ++i) {  // 1000 s.
      const StampClock::Reading reading = device.next(clock);
      EXPECT_EQ(reading.event, i == 0 ? StampEvent::kFirst : StampEvent::kSteady);
      if (i > 100) largest = std::max(largest, std::abs(device.errorS(reading)));
    }
    EXPECT_LT(largest, 0.0015);
    EXPECT_GT(largest, 0.0);
  }
}

TEST(StampClock, AJamDelaysFramesButNotTheirStamps) {
  StampClock clock;
  Device device;
  for (int i = 0; i < 300; ++i) (void)device.next(clock);
  for (int i = 0; i < 30; ++i) {
    const StampClock::Reading reading = device.next(clock, /*delay_s=*/0.2);
    EXPECT_EQ(reading.event, StampEvent::kLate);
    EXPECT_LT(std::abs(device.errorS(reading)), 0.002);
  }
  EXPECT_EQ(device.next(clock).event, StampEvent::kSteady);
}

TEST(StampClock, SaysWhenTheDeviceClockIsSetAheadOrBackOrStartsAgain) {
  for (const double step_s : {0.3, -0.3, -1000.0, 5000.0, -0.06}) {
    SCOPED_TRACE(step_s);
    StampClock clock;
    Device device;
    for (int i = 0; i < 300; ++i) (void)device.next(clock);
    std::vector<StampEvent> events{device.next(clock, 0.0, step_s).event};
    StampClock::Reading last;
    for (int i = 0; i < 300; ++i) {
      last = device.next(clock);
      events.push_back(last.event);
    }
    const auto told = [](StampEvent event) {
      return event == StampEvent::kJumped || event == StampEvent::kReset;
    };
    EXPECT_EQ(std::count_if(events.begin(), events.end(), told), 1);
    if (step_s < -0.1) {
      EXPECT_EQ(events.front(), StampEvent::kReset);
    }
    EXPECT_LT(std::abs(device.errorS(last)), 0.002);
  }
}

TEST(StampClock, AnAnnouncedWrapIsNoReset) {
  StampClockOptions options;
  options.wrap_s = 4294.967296;  // 32 bits of microseconds.
  StampClock clock(options);
  Device device;
  device.start_s = 4290.0;
  device.wrap_s = options.wrap_s;
  int wraps = 0;
  for (int i = 0; i < 600; ++i) {
    const StampClock::Reading reading = device.next(clock);
    wraps += reading.event == StampEvent::kWrapped;
    EXPECT_NE(reading.event, StampEvent::kReset);
    if (i > 60) {
      EXPECT_LT(std::abs(device.errorS(reading)), 0.004);
    }
  }
  EXPECT_EQ(wraps, 1);
}

TEST(StampClock, RejectsNonsense) {
  StampClock clock;
  EXPECT_THROW((void)clock.read(std::nan(""), Instant{}), std::invalid_argument);
  StampClockOptions options;
  options.max_drift_ppm = -1.0;
  EXPECT_THROW(StampClock{options}, std::invalid_argument);
}

}  // namespace
}  // namespace servocal::sensor
