// SPDX-License-Identifier: GPL-3.0-or-later
// What goes wrong on the way, and how a drive ends then. Times are read from the arm's command log.
#include <gtest/gtest.h>

#include "servo_bench.h"

namespace servocal::servo {
namespace {

using test::Bench;
using test::BenchOptions;
using test::FakeArm;
using test::kDegree;

const Pose<Color, Board> kGoal = Bench::view({0.15, -0.06, 0.55}, {0.2, -0.2, 0.1});

double progress(Bench& bench, const RobotState& state) {
  const auto start = bench.kinematics.forward(bench.start_q), goal = bench.flangeFor(kGoal);
  return distanceM(start, state.bMe) / distanceM(start, goal);
}

// Latest instant after `from` and before `until` at which the arm is told to move.
std::optional<Instant> lastTold(const FakeArm& arm, Instant from, Instant until) {
  std::optional<Instant> last;
  for (Instant at = from; at < until; at += std::chrono::milliseconds(1))
    if (!arm.toldAt(at).isZero()) last = at;
  return last;
}

TEST(DriveFaults, TheBenchWorksWithoutFaults) {
  for (const bool known : {false, true}) {
    Bench bench;
    const DriveOutcome outcome = bench.drive(kGoal, bench.truth(known));
    EXPECT_EQ(outcome.status, DriveStatus::kReached) << outcome.reason;
    EXPECT_EQ(outcome.losses, 0);
    EXPECT_GT(outcome.frames, 20);
  }
}

// Lost in full motion: zero twist at most 150 ms after the last frame that showed the target; back along the
// path after 0.5 s; three tries; at the end at rest where it is seen.
TEST(DriveFaults, LostTargetStopsGoesBackAndGivesUp) {
  for (const bool known : {false, true}) {
    for (const double where : {0.3, 0.5, 0.7}) {
      Bench bench;
      std::vector<Instant> last_seen;  // Of each loss.
      std::optional<Instant> seen;
      bool lost = false;
      bench.observer.visible = [&](Instant stamp, const RobotState& state) {
        const bool visible = progress(bench, state) < where;
        if (visible) seen = stamp;
        if (!visible && !lost && seen) last_seen.push_back(*seen);
        lost = !visible;
        return visible;
      };
      const DriveOutcome outcome = bench.drive(kGoal, bench.truth(known));
      EXPECT_EQ(outcome.status, DriveStatus::kTargetLost) << outcome.reason;
      EXPECT_EQ(outcome.losses, 3);
      EXPECT_TRUE(bench.arm.state().twist.isZero());
      EXPECT_LT(progress(bench, bench.arm.state()), where);
      EXPECT_GT(progress(bench, bench.arm.state()), 0.3 * where);  // Not all the way back.
      ASSERT_GE(last_seen.size(), 1u);
      const Instant loss = last_seen.front();
      EXPECT_FALSE(bench.arm.toldAt(loss + std::chrono::milliseconds(50)).isZero());  // It did move.
      const Instant retreat = loss + std::chrono::milliseconds(490);
      const auto last = lastTold(bench.arm, loss, retreat);
      ASSERT_TRUE(last);
      EXPECT_LT(toSeconds(*last - loss), 0.150);
      // The retreat, soon after half a second.
      EXPECT_TRUE(lastTold(bench.arm, loss + std::chrono::milliseconds(500), loss + std::chrono::milliseconds(560)));
    }
  }
}

// Negative control: with patience and a patient guard the arm would go on blindly for longer.
TEST(DriveFaults, WithoutTheRuleTheArmGoesOnBlindly) {
  BenchOptions options;
  options.guard.max_frame_age = std::chrono::seconds(10);
  Bench bench(options);
  std::optional<Instant> loss;
  bench.observer.visible = [&](Instant stamp, const RobotState& state) {
    if (progress(bench, state) < 0.5 && !loss) return true;
    if (!loss) loss = stamp;
    bench.observer.dead = true;
    return true;
  };
  DriveOptions patient;
  patient.lost_stop = std::chrono::seconds(10);
  (void)bench.drive(kGoal, bench.truth(false), patient);
  ASSERT_TRUE(loss);
  EXPECT_TRUE(lastTold(bench.arm, *loss + std::chrono::milliseconds(200), *loss + std::chrono::milliseconds(490)));
}

// A single frame without the target is no loss.
TEST(DriveFaults, ASingleMissedFrameOnlySlowsDown) {
  Bench bench;
  int frame = 0;
  bench.observer.visible = [&](Instant, const RobotState&) { return ++frame % 6 != 0; };
  const DriveOutcome outcome = bench.drive(kGoal, bench.truth(true));
  EXPECT_EQ(outcome.status, DriveStatus::kReached) << outcome.reason;
  EXPECT_EQ(outcome.losses, 0);
}

// Hidden for a while, then back: found on the way back, and the drive goes on to its goal.
TEST(DriveFaults, GoesOnWhenTheTargetIsFoundAgain) {
  Bench bench;
  std::optional<Instant> hidden;
  bench.observer.visible = [&](Instant stamp, const RobotState& state) {
    if (!hidden && progress(bench, state) > 0.5) hidden = stamp;
    return !hidden || stamp < *hidden || stamp > *hidden + std::chrono::milliseconds(900);
  };
  const DriveOutcome outcome = bench.drive(kGoal, bench.truth(true));
  EXPECT_EQ(outcome.status, DriveStatus::kReached) << outcome.reason;
  EXPECT_EQ(outcome.losses, 1);
}

TEST(DriveFaults, NeverInSightEndsSoonAndMovesNothing) {
  Bench bench;
  bench.observer.visible = [](Instant, const RobotState&) { return false; };
  const DriveOutcome outcome = bench.drive(kGoal, bench.truth(true));
  EXPECT_EQ(outcome.status, DriveStatus::kTargetLost);
  EXPECT_FALSE(outcome.last);
  EXPECT_FALSE(bench.guard->motionSpan());
  EXPECT_LT(toSeconds(outcome.elapsed), 1.5);
}

// The camera dies on the way: the arm stands within the same 150 ms and waits; no blind retreat.
TEST(DriveFaults, StopsWhenFramesCease) {
  Bench bench;
  bench.observer.visible = [&](Instant, const RobotState& state) {
    if (progress(bench, state) > 0.5) bench.observer.dead = true;
    return true;
  };
  const DriveOutcome outcome = bench.drive(kGoal, bench.truth(true));
  EXPECT_EQ(outcome.status, DriveStatus::kTargetLost) << outcome.reason;
  EXPECT_NE(outcome.reason.find("No frame"), std::string::npos) << outcome.reason;
  ASSERT_TRUE(bench.observer.last_seen);
  const auto last = lastTold(bench.arm, *bench.observer.last_seen, bench.clock.now());
  ASSERT_TRUE(last);
  EXPECT_LT(toSeconds(*last - *bench.observer.last_seen), 0.150);
}

// Frames 300 ms old move nothing, nor do frames from the future.
TEST(DriveFaults, StaleFramesMoveNothing) {
  for (const int error_ms : {-300, +300}) {
    Bench bench;
    bench.observer.stamp_error = std::chrono::milliseconds(error_ms);
    const DriveOutcome outcome = bench.drive(kGoal, bench.truth(true));
    EXPECT_EQ(outcome.status, DriveStatus::kTargetLost) << outcome.reason;
    EXPECT_FALSE(bench.guard->motionSpan());
  }
}

TEST(DriveFaults, OperatorStopEndsWithinOneCycle) {
  for (const bool known : {false, true}) {
    Bench bench;
    std::optional<Instant> asked;
    bench.arm.on_step = [&](const RobotState& state) {
      if (asked || progress(bench, state) < 0.5) return;
      asked = state.stamp;
      bench.guard->operatorStop();
    };
    const DriveOutcome outcome = bench.drive(kGoal, bench.truth(known));
    EXPECT_EQ(outcome.status, DriveStatus::kStopped);
    ASSERT_TRUE(asked);
    EXPECT_TRUE(bench.arm.toldAt(*asked + std::chrono::milliseconds(10)).isZero());
    EXPECT_TRUE(bench.arm.state().twist.isZero());
    EXPECT_EQ(bench.drive(kGoal, bench.truth(known)).status, DriveStatus::kStopped);  // Latched.
  }
}

// A wall between here and the goal. Known camera pose: refused before any motion. Unknown: the guard says no.
TEST(DriveFaults, AWallOnTheWayIsALimit) {
  Bench plain;
  const auto start = plain.kinematics.forward(plain.start_q), goal = plain.flangeFor(kGoal);
  const Eigen::Vector3d middle = 0.5 * ((start * plain.eMo).translation() + (goal * plain.eMo).translation());
  BenchOptions options;
  options.limits.keep_out = {{"post", middle + Eigen::Vector3d(0.13, -0.3, -0.3), middle + Eigen::Vector3d(0.16, 0.3, 0.3)}};
  Bench known(options);
  ASSERT_TRUE(known.guard->allows(start));
  const DriveOutcome refused = known.drive(kGoal, known.truth(true));
  EXPECT_TRUE(refused.status == DriveStatus::kLimit || refused.status == DriveStatus::kUnreachable) << refused.reason;
  EXPECT_NE(refused.reason.find("'post'"), std::string::npos) << refused.reason;
  EXPECT_FALSE(known.guard->motionSpan());

  Bench unknown(options);
  const DriveOutcome stopped = unknown.drive(kGoal, unknown.truth(false));
  EXPECT_EQ(stopped.status, DriveStatus::kLimit) << stopped.reason;
  EXPECT_NE(stopped.reason.find("'post'"), std::string::npos) << stopped.reason;
  EXPECT_TRUE(unknown.guard->motionSpan());
  EXPECT_TRUE(unknown.guard->allows(unknown.arm.state().bMe));
}

// The mount turned by half a turn about the board's normal: every motion in the image plane goes the wrong way.
TEST(DriveFaults, AWrongSignIsNoticedBeforeTheTargetIsLost) {
  Bench bench;
  CellEstimate cell = bench.truth(false);
  cell.eMo = bench.eMo * Pose<Board, Board>::fromRotationVector({0, 0, M_PI}, Eigen::Vector3d::Zero());
  const DriveOutcome outcome = bench.drive(Bench::view({0.06, -0.03, 0.6}, {0, 0, 0}), cell);
  EXPECT_EQ(outcome.status, DriveStatus::kLimit) << outcome.reason;
  EXPECT_NE(outcome.reason.find("a sign or a frame"), std::string::npos) << outcome.reason;
  EXPECT_EQ(outcome.losses, 0);
  EXPECT_LT(toSeconds(outcome.elapsed), 2.0);
  EXPECT_TRUE(bench.arm.state().twist.isZero());
}

TEST(DriveFaults, RefusesGoalsOutOfReachAndOutOfTheImageBeforeMoving) {
  Bench bench;
  const DriveOutcome far = bench.drive(Bench::view({0, 0, 3.0}, {0, 0, 0}), bench.truth(true));
  EXPECT_EQ(far.status, DriveStatus::kUnreachable) << far.reason;
  const DriveOutcome outside = bench.drive(Bench::view({0.6, 0, 0.6}, {0, 0, 0}), bench.truth(false));
  EXPECT_EQ(outside.status, DriveStatus::kUnreachable) << outside.reason;
  const DriveOutcome behind = bench.drive(Bench::view({0, 0, -0.6}, {0, 0, 0}), bench.truth(false));
  EXPECT_EQ(behind.status, DriveStatus::kUnreachable) << behind.reason;
  EXPECT_FALSE(bench.guard->motionSpan());
}

TEST(DriveFaults, TimesOutAtRest) {
  Bench bench;
  DriveOptions options;
  options.timeout = std::chrono::milliseconds(700);
  const DriveOutcome outcome = bench.drive(kGoal, bench.truth(false), options);
  EXPECT_EQ(outcome.status, DriveStatus::kPlateau) << outcome.reason;
  EXPECT_TRUE(bench.arm.state().twist.isZero());
  EXPECT_LT(toSeconds(outcome.elapsed), 1.1);
}

struct BrokenEyes final : Observer {
  explicit BrokenEyes(Bench& its_bench) : bench(its_bench) {}
  Look look(Instant deadline) override {
    if (toSeconds(bench.clock.now()) > 0.6) throw std::runtime_error("unplugged");
    return bench.observer.look(deadline);
  }
  Bench& bench;
};

TEST(DriveFaults, AnExceptionOfTheCameraStopsTheArm) {
  Bench bench;
  BrokenEyes eyes(bench);
  EXPECT_THROW((void)drive(*bench.guard, bench.clock, eyes, bench.points_o, kGoal, bench.truth(true)), std::runtime_error);
  EXPECT_TRUE(bench.arm.log().back().stop);
  EXPECT_TRUE(bench.guard->motionSpan());
}

TEST(DriveFaults, RefusesWhatIsNotAGoal) {
  Bench bench;
  EXPECT_THROW((void)bench.drive(Pose<Color, Board>(), bench.truth(true)), std::invalid_argument);
  CellEstimate cell = bench.truth(true);
  cell.eMo = {};
  EXPECT_THROW((void)bench.drive(kGoal, cell), std::invalid_argument);
  const std::vector<Eigen::Vector3d> line = {{0, 0, 0}, {0.1, 0, 0}, {0.2, 0, 0}, {0.3, 0, 0}};
  EXPECT_THROW((void)drive(*bench.guard, bench.clock, bench.observer, line, kGoal, bench.truth(true)), std::invalid_argument);
  EXPECT_THROW((void)moveTo(*bench.guard, bench.clock, Pose<Base, EndEffector>()), std::invalid_argument);
}

TEST(MoveToFaults, EndsInALimitOrOutOfReach) {
  Bench bench;
  const Pose<Base, EndEffector> far(Eigen::Matrix3d::Identity(), {0.9, 0.9, 0.5});
  EXPECT_EQ(moveTo(*bench.guard, bench.clock, far).status, DriveStatus::kUnreachable);
  bench.guard->operatorStop();
  EXPECT_EQ(moveTo(*bench.guard, bench.clock, bench.flangeFor(kGoal)).status, DriveStatus::kStopped);
  EXPECT_FALSE(bench.guard->motionSpan());
}

}  // namespace
}  // namespace servocal::servo
