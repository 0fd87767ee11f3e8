// SPDX-License-Identifier: GPL-3.0-or-later
// Something breaks while the arm moves: it stops, the driver says why, and nothing moves again by itself.
#include <gtest/gtest.h>

#include <algorithm>

#include "ur_cell.h"

namespace servocal::robot::ur {
namespace {

using namespace test;

/// Moves the arm, breaks it, and returns the Error; the arm must stand soon after.
std::optional<Error> errorInMotion(UrCell& cell, Arm& arm, UrFault fault) {
  EXPECT_FALSE(cell.drive(arm, UrCell::up(), [&] { return cell.moves(); })) << static_cast<int>(fault);
  EXPECT_TRUE(cell.moves()) << static_cast<int>(fault);
  cell.controller.misbehave(fault);
  const auto error = cell.drive(arm, UrCell::up(), [] { return false; });
  EXPECT_TRUE(cell.waitFor([&] { return cell.stands(); })) << static_cast<int>(fault);
  return error;
}

TEST(UrWireFault, EndsInAStoppedArmAndAClearSentence) {
  const std::pair<UrFault, const char*> cases[] = {
      {UrFault::kOversizePackage, "a data package is 4 bytes longer than it should be"},
      {UrFault::kOversizeHeader, "claims a size of 65535 bytes"},
      {UrFault::kZeroSize, "claims a size of 0 bytes"},
      {UrFault::kUnknownType, "unknown type 88"},
      {UrFault::kForeignRecipe, "recipe 7 came, only 1 was asked for"},
      {UrFault::kOutOfOrder, "its clock ran backwards"},
      {UrFault::kNotFinite, "not finite"},
      {UrFault::kGarbage, "cannot be understood"},
      {UrFault::kSilent, "sent no state for"},
      {UrFault::kClosesLink, "closed the connection"}};
  for (const auto& [fault, part] : cases) {
    UrCell cell;
    const auto arm = cell.armed();
    const auto error = errorInMotion(cell, *arm, fault);
    ASSERT_TRUE(error.has_value()) << part;
    EXPECT_EQ(error->kind(), ErrorKind::kHardwareAbsent) << part;
    expectPart(error->what(), part);
    EXPECT_FALSE(arm->armed());
    // The link is gone for good: nothing moves, whatever is asked.
    cell.controller.behave();
    expectPart(messageOf(ErrorKind::kHardwareAbsent, [&] { arm->arm("2014350123"); }), part);
    arm->stop(forgedMotionKey());
    EXPECT_TRUE(cell.stands());
  }
}

TEST(UrWireFault, RepeatedPackagesAreCountedAndIgnored) {
  UrCell cell;
  const auto arm = cell.armed();
  cell.controller.misbehave(UrFault::kRepeatedPackages);
  EXPECT_FALSE(cell.drive(*arm, UrCell::up(), [&] { return arm->report().repeated > 20; }));
  const LinkReport report = arm->report();
  EXPECT_GT(report.repeated, 20u);
  EXPECT_EQ(report.missed, 0u);
}

TEST(UrWireFault, PackagesThatNeverCameAreCounted) {
  UrCell cell;
  const auto arm = cell.connected();
  cell.controller.misbehave(UrFault::kSilent);
  cell.clock.sleepFor(std::chrono::milliseconds(100));
  cell.controller.behave();
  EXPECT_TRUE(cell.waitFor([&] { return arm->report().missed > 0; }));
}

// Arrivals come 0 to 40 ms late; neither the arm nor the stamps of its states follow them.
TEST(UrWireFault, JitterIsNoFaultAndDoesNotReachTheStamps) {
  UrCell cell;
  const auto arm = cell.armed();
  cell.controller.misbehave(UrFault::kJitter);
  double least_s = 1e9, most_s = -1e9;
  const std::size_t before = arm->report().states;
  const auto error = cell.drive(*arm, UrCell::up(), [&] {
    const RobotState state = arm->state();
    const double offset_s = toSeconds(state.stamp) - state.device_stamp_s;
    least_s = std::min(least_s, offset_s);
    most_s = std::max(most_s, offset_s);
    return arm->report().states > before + 200;
  });
  ASSERT_FALSE(error) << error->what();
  EXPECT_TRUE(cell.moves());
  EXPECT_EQ(arm->report().missed, 0u);
  EXPECT_LT(most_s - least_s, 0.008);
}

// A cable that loses one package in ten: TCP sends again, so states and commands come 200 ms late. That is
// silence to the driver, and it gives up; one with more patience shows that nothing else would have.
TEST(UrWireFault, LossOfTenPercentStopsTheArm) {
  {
    UrCell cell;
    ArmOptions options = patient();
    options.dead_peer = std::chrono::milliseconds(150);
    options.watchdog = std::chrono::milliseconds(300);
    const auto arm = cell.armed(options);
    const auto error = errorInMotion(cell, *arm, UrFault::kLossy);
    ASSERT_TRUE(error.has_value());
    EXPECT_EQ(error->kind(), ErrorKind::kHardwareAbsent);
    expectPart(error->what(), "sent no state for");
    const UrControllerTruth truth = cell.controller.truth();
    EXPECT_LT(truth.last_motion_s - truth.last_moving_input_s, 0.6);
  }
  UrCell cell;
  const auto arm = cell.armed();
  cell.controller.misbehave(UrFault::kLossy);
  const Instant end = cell.clock.now() + std::chrono::milliseconds(1500);
  const auto error = cell.drive(*arm, UrCell::up(), [&] { return cell.clock.now() > end; });
  EXPECT_FALSE(error) << error->what();
  EXPECT_TRUE(cell.moves());
}

TEST(UrArmFault, ReducedModeIsReportedAndNoStop) {
  UrCell cell;
  const auto arm = cell.armed();
  EXPECT_EQ(arm->report().safety_mode, 1);
  cell.controller.misbehave(UrFault::kReducedMode);
  const auto error =
      cell.drive(*arm, UrCell::up(), [&] { return arm->report().safety_mode == 2 && cell.moves(); });
  EXPECT_FALSE(error) << error->what();
  EXPECT_EQ(arm->report().safety_mode, 2);
  EXPECT_TRUE(arm->armed());
}

TEST(UrArmFault, IsLatchedAndNamed) {
  const std::pair<UrFault, const char*> cases[] = {{UrFault::kProtectiveStop, "made a protective stop"},
                                                   {UrFault::kEmergencyStop, "emergency stop is pressed"},
                                                   {UrFault::kPowerOff, "not running (robot mode 3)"},
                                                   {UrFault::kTeachButton, "teach button"},
                                                   {UrFault::kSliderZero, "stands at 0 %"},
                                                   {UrFault::kTcpChanged, "active TCP was changed"},
                                                   {UrFault::kPayloadChanged, "from 0.500 to 2.000 kg"},
                                                   {UrFault::kProgramPaused, "paused or stopped"},
                                                   {UrFault::kProgramStopped, "paused or stopped"},
                                                   {UrFault::kOtherProgram, "Another program"}};
  for (const auto& [fault, part] : cases) {
    UrCell cell;
    const auto arm = cell.armed();
    const auto error = errorInMotion(cell, *arm, fault);
    ASSERT_TRUE(error.has_value()) << part;
    EXPECT_EQ(error->kind(), ErrorKind::kSafetyStop) << part;
    expectPart(error->what(), part);
    // All is well again at the arm: still nothing moves before it is armed anew.
    cell.controller.behave();
    const UrControllerTruth before = cell.controller.truth();
    EXPECT_TRUE(cell.drive(*arm, UrCell::up(), [] { return false; })) << part;
    cell.clock.sleepFor(std::chrono::milliseconds(300));
    EXPECT_LT((cell.controller.truth().q - before.q).cwiseAbs().maxCoeff(), 1e-3) << part;
    arm->arm("2014350123");
    EXPECT_FALSE(cell.drive(*arm, UrCell::up(), [&] { return cell.moves(); })) << part;
    EXPECT_TRUE(cell.moves()) << part;
  }
}

// The registers still hold the last twist when a paused program goes on; the driver is gone by then.
TEST(UrArmFault, ResumedProgramWithoutUsStaysStill) {
  UrCell cell;
  ArmOptions options = patient();
  options.watchdog = std::chrono::milliseconds(200);
  auto arm = cell.armed(options);
  EXPECT_FALSE(cell.drive(*arm, UrCell::up(), [&] { return cell.moves(); }));
  cell.controller.misbehave(UrFault::kDeaf);
  cell.controller.misbehave(UrFault::kProgramPaused);
  ASSERT_TRUE(cell.waitFor([&] { return cell.stands(); }));
  arm.reset();
  cell.clock.sleepFor(std::chrono::milliseconds(300));
  const auto before = cell.controller.truth().q;
  cell.controller.behave();
  cell.clock.sleepFor(std::chrono::milliseconds(500));
  EXPECT_LT((cell.controller.truth().q - before).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(UrArmFault, HalfASliderIsReported) {
  UrCell cell;
  const auto arm = cell.armed();
  EXPECT_EQ(arm->report().speed_slider_min, 1.0);
  cell.controller.misbehave(UrFault::kSliderHalf);
  EXPECT_TRUE(cell.waitFor([&] { return arm->report().speed_slider_min == 0.5; }));
  EXPECT_EQ(arm->report().speed_slider_max, 1.0);
  EXPECT_TRUE(arm->armed());
}

TEST(UrDriver, RefusesNonsense) {
  UrCell cell;
  const auto arm = cell.armed();
  Twist<Base> twist;
  twist.linear_mps.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(arm->move(forgedMotionKey(), twist, std::chrono::milliseconds(100)), std::invalid_argument);
  EXPECT_THROW(arm->moveJoints(forgedMotionKey(), Eigen::VectorXd::Zero(5), std::chrono::milliseconds(100)),
               std::invalid_argument);
  ArmOptions options;
  options.watchdog = std::chrono::seconds(2);
  EXPECT_THROW(cell.connected(options), std::invalid_argument);
  cell.config.ur.reset();
  EXPECT_THROW(cell.connected(), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::robot::ur
