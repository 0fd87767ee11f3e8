// SPDX-License-Identifier: GPL-3.0-or-later
#include <stdexcept>

#include "approach.h"
#include "motion_loop.h"
#include "servocal/servo/drive.h"

namespace servocal::servo {
namespace {

constexpr double kThereM = 0.0003;
constexpr double kThereRad = 0.0005;

}  // namespace

DriveOutcome moveTo(robot::Guard& guard, Clock& clock, const Pose<Base, EndEffector>& bMe,
                    Duration timeout) {
  if (!bMe.isFinite()) throw std::invalid_argument("moveTo: the goal is not a number");
  const StopOnExit stop(guard);
  const Instant start = clock.now();
  const auto end = [&](DriveStatus status, const std::string& reason) {
    guard.stopAndWait();
    DriveOutcome outcome;
    outcome.status = status;
    outcome.reason = reason;
    outcome.elapsed = clock.now() - start;
    return outcome;
  };

  if (guard.operatorStopped()) return end(DriveStatus::kStopped, "The operator asked to stop.");
  if (const auto objection = rehearse(guard, guard.state(), bMe))
    return end(objection->goal ? DriveStatus::kUnreachable : DriveStatus::kLimit, objection->reason);

  RefusalTimer refusals;
  for (;;) {
    const Pose<Base, EndEffector> here = guard.state().bMe;
    if (distanceM(here, bMe) < kThereM && angleRad(here, bMe) < kThereRad)
      return end(DriveStatus::kReached, "The arm is there.");
    if (clock.now() - start > timeout)
      return end(DriveStatus::kPlateau, "The time ran out before the arm was there.");
    const robot::GuardVerdict verdict =
        guard.command(approach(here, bMe, guard.limits(), kRobotGain, 1.0));
    if (verdict.rule == robot::GuardRule::kOperatorStop) return end(DriveStatus::kStopped, verdict.reason);
    if (refusals.lasted(verdict, clock.now())) return end(DriveStatus::kLimit, verdict.reason);
    clock.sleepFor(kTick);
  }
}

}  // namespace servocal::servo
