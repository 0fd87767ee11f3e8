// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/time_offset.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "calib_scene.h"

namespace servocal::calib {
namespace {

struct Ride {
  std::vector<TimedBoard> samples;
  std::vector<RobotState> states;
  Pose<EndEffector, Board> eMo;
};

/// Four seconds of an arm that swings with 50 mm amplitude and turns, seen at 30 Hz; states at 125 Hz.
Ride makeRide(std::uint64_t seed, double offset_s, double noise_m, double amplitude_m = 0.05) {
  std::mt19937_64 random(seed);
  Ride ride;
  ride.eMo = test::randomPose<EndEffector, Board>(random, 0.5, 0.05);
  const auto bMc = test::randomPose<Base, Color>(random, 1.0, 1.0);
  const auto bMe = [&](double t) {
    return Pose<Base, EndEffector>::fromRotationVector(
        Eigen::Vector3d(0.1 * std::sin(1.5 * t), 0.2, 0.1) * (amplitude_m / 0.05),
        Eigen::Vector3d(0.5 + amplitude_m * std::sin(2.5 * t), 0.1,
                        0.4 + 0.4 * amplitude_m * std::sin(1.7 * t + 1)));
  };
  for (int k = 0; k < 600; ++k) {
    RobotState state;
    state.stamp = Instant{} + fromSeconds(k * 0.008);
    state.bMe = bMe(k * 0.008);
    ride.states.push_back(state);
  }
  for (int k = 0; k < 120; ++k) {
    const double t = 0.4 + k / 30.0;
    ride.samples.push_back({Instant{} + fromSeconds(t + offset_s),
                            test::disturbed(bMc.inverse() * bMe(t) * ride.eMo, random, noise_m, 0.0)});
  }
  return ride;
}

TEST(TimeOffset, RecoversTruthFromNoiselessRide) {
  for (const double offset_s : {-0.08, 0.0, 0.0123, 0.08}) {
    const Ride ride = makeRide(1, offset_s, 0.0);
    const TimeOffset result = estimateTimeOffset(ride.samples, ride.states, ride.eMo);
    ASSERT_EQ(result.status, TimeOffsetStatus::kSolved) << toString(result.status);
    EXPECT_NEAR(result.offset_s, offset_s, 1e-4);
  }
}

TEST(TimeOffset, SigmaIsTheSpread) {
  constexpr int kSeeds = 60;
  double squares = 0.0;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    const Ride ride = makeRide(static_cast<std::uint64_t>(seed), 0.065, 0.001);
    const TimeOffset result = estimateTimeOffset(ride.samples, ride.states, ride.eMo);
    ASSERT_EQ(result.status, TimeOffsetStatus::kSolved) << toString(result.status);
    squares += std::pow((result.offset_s - 0.065) / result.sigma_s, 2) / kSeeds;
    EXPECT_LT(result.sigma_s, 0.002);
  }
  EXPECT_NEAR(squares, 1.0, 4.0 * std::sqrt(2.0 / kSeeds));
}

TEST(TimeOffset, WrongPosesAreLeftOut) {
  Ride ride = makeRide(3, 0.04, 0.0005);
  for (std::size_t i = 5; i < ride.samples.size(); i += 10) {
    ride.samples[i].cMo =
        ride.samples[i].cMo * Pose<Board, Board>::fromRotationVector({0, 0, 0}, {0.05, 0.02, 0});
  }
  const TimeOffset result = estimateTimeOffset(ride.samples, ride.states, ride.eMo);
  ASSERT_EQ(result.status, TimeOffsetStatus::kSolved) << toString(result.status);
  EXPECT_NEAR(result.offset_s, 0.04, 0.002);
}

TEST(TimeOffset, RefusesWithoutMotionOrSamples) {
  Ride still = makeRide(4, 0.04, 0.001, 0.0);
  EXPECT_EQ(estimateTimeOffset(still.samples, still.states, still.eMo).status, TimeOffsetStatus::kNoMotion);
  Ride ride = makeRide(4, 0.04, 0.001);
  ride.samples.resize(8);
  EXPECT_EQ(estimateTimeOffset(ride.samples, ride.states, ride.eMo).status, TimeOffsetStatus::kTooFewSamples);
  std::swap(ride.states[3], ride.states[9]);
  EXPECT_THROW((void)estimateTimeOffset(ride.samples, ride.states, ride.eMo), std::invalid_argument);
}

// The arm moved unrecorded from one second to the next: interpolated, its path would be wrong.
TEST(TimeOffset, SamplesBesideGapsOfTheHistoryDoNotCount) {
  Ride ride = makeRide(6, 0.04, 0.0);
  ride.states.erase(ride.states.begin() + 200, ride.states.begin() + 320);
  const TimeOffset result = estimateTimeOffset(ride.samples, ride.states, ride.eMo);
  ASSERT_EQ(result.status, TimeOffsetStatus::kSolved) << toString(result.status);
  EXPECT_NEAR(result.offset_s, 0.04, 1e-4);
  EXPECT_LT(result.samples, 90);
}

TEST(TimeOffset, RefusesConstantSpeed) {
  Ride ride = makeRide(5, 0.04, 0.0005);
  const auto line = [](double t) {
    return Pose<Base, EndEffector>(Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.1 + 0.05 * t, 0, 0));
  };
  for (RobotState& state : ride.states) state.bMe = line(toSeconds(state.stamp));
  for (TimedBoard& sample : ride.samples) {
    sample.cMo = relabel<Color, Board>(line(toSeconds(sample.stamp) - 0.04));
  }
  std::mt19937_64 random(1);
  for (TimedBoard& sample : ride.samples) sample.cMo = test::disturbed(sample.cMo, random, 0.0005, 0.0);
  const TimeOffset result =
      estimateTimeOffset(ride.samples, ride.states, Pose<EndEffector, Board>::identity());
  EXPECT_NE(result.status, TimeOffsetStatus::kSolved);
}

}  // namespace
}  // namespace servocal::calib
