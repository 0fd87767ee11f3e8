// SPDX-License-Identifier: GPL-3.0-or-later
// Random and adversarial commands against an arm that does whatever it is told: no limit is ever broken.
#include <gtest/gtest.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "fake_arm.h"
#include "servocal/robot/guard.h"

namespace servocal::robot {
namespace {

using test::FakeArm;
using test::FakeArmOptions;

constexpr double kHuge = 1e9;
#ifndef SERVOCAL_SEQUENCES
#define SERVOCAL_SEQUENCES 150  // The nightly test runs many more.
#endif
constexpr int kSequences = SERVOCAL_SEQUENCES;
constexpr int kCommands = 100;  // Of a sequence.
// Sequences beyond the few that once broke a limit: 1670 asks for a twist beside a singular pose that the arm has come
// nearer to than its state, some milliseconds old, says.
constexpr int kOnceBroke[] = {1670};

MotionLimits cellLimits() {
  MotionLimits limits;
  limits.workspace = {"workspace", {-0.9, -0.9, 0.05}, {0.9, 0.9, 1.1}};
  limits.keep_out = {{"pedestal", {-0.15, -0.15, 0.0}, {0.15, 0.15, 0.45}},
                     {"camera", {-0.2, -0.95, 0.3}, {0.1, -0.75, 0.6}},
                     {"shelf", {0.4, 0.1, 0.5}, {0.6, 0.5, 0.7}}};
  return limits;
}

// How often a limit was broken, and the worst time: how many times the limit (0: not a matter of degree), and where.
struct Breach {
  int count = 0;
  double times = 0.0;
  int sequence = 0;
  Eigen::VectorXd q;
};

// Collects, by name, how often the true state breaks the true limits.
class Violations {
 public:
  Violations(const Kinematics& kinematics, const MotionLimits& limits, const BoardSpec& board,
             const Pose<EndEffector, Board>& eMo, double tolerance, double tolerance_m, int sequence = 0)
      : kinematics_(kinematics), limits_(limits), links_(ArmConfig{}, limits.keep_out, board), tolerance_(tolerance),
        tolerance_m_(tolerance_m), sequence_(sequence) {
    links_.setBoard(eMo);
    for (const Eigen::Vector3d& corner_o : board.outline()) corners_e_.push_back(eMo * corner_o);
    points_e_ = corners_e_;
    for (const Eigen::Vector3d& corner_o : board.corners()) points_e_.push_back(eMo * corner_o);
    points_e_.push_back(Eigen::Vector3d::Zero());
  }

  void watch(const RobotState& state) {
    q_ = state.q;
    atMost("flange speed", state.twist.linear_mps.norm() / limits_.max_speed_mps, tolerance_);
    atMost("angular speed", state.twist.angular_radps.norm() / limits_.max_angular_speed_radps, tolerance_);
    for (const Eigen::Vector3d& corner_e : corners_e_) {
      const Eigen::Vector3d lever = state.bMe.rotation() * corner_e;
      atMost("corner speed",
             (state.twist.linear_mps + state.twist.angular_radps.cross(lever)).norm() / limits_.max_speed_mps, tolerance_);
    }
    for (Eigen::Index joint = 0; joint < state.q.size(); ++joint)
      if (state.q[joint] < kinematics_.lower()[joint] + limits_.joint_margin_rad - 1e-4 ||
          state.q[joint] > kinematics_.upper()[joint] - limits_.joint_margin_rad + 1e-4)
        note("joint limit");
    if (last_.q.size() && state.stamp > last_.stamp)
      atMost("joint speed", (state.q - last_.q).cwiseAbs().maxCoeff() / toSeconds(state.stamp - last_.stamp) /
                                limits_.max_joint_speed_radps, tolerance_ + 0.01);
    for (const CollisionModel::Gap& gap : links_.gaps(state.q))
      if (gap.distance_m < 0.0) note("links");
    if (last_.q.size()) travelled_m += distanceM(last_.bMe, state.bMe);
    last_ = state;
    for (const Eigen::Vector3d& point_e : points_e_) {
      const Eigen::Vector3d point = state.bMe * point_e;
      const Eigen::Array3d slack = Eigen::Array3d::Constant(tolerance_m_);
      if ((point.array() < limits_.workspace.min_m.array() - slack).any() ||
          (point.array() > limits_.workspace.max_m.array() + slack).any())
        note("workspace");
      for (const Box& box : limits_.keep_out)
        if ((point.array() > box.min_m.array() + slack).all() && (point.array() < box.max_m.array() - slack).all())
          note("keep-out");
    }
  }
  void watchAcceleration(const FakeArm& arm) {
    for (std::size_t i = 1; i < arm.log().size(); ++i) {
      const FakeArm::Command &before = arm.log()[i - 1], &now = arm.log()[i];
      // An emergency stop brakes harder, and after a pause the arm has braked by itself.
      const double dt = toSeconds(now.at - before.at);
      if (now.stop || before.stop || now.at > before.at + before.valid_for) continue;
      if (now.joints.size() != before.joints.size() && !before.twist.isZero()) note("change of kind in motion");
      if (now.joints.size() > 0 && before.joints.size() > 0) {
        const double from_rest_s = before.joints.isZero() ? std::min(dt, 0.008) : dt;
        atMost("joint acceleration", ((now.joints - before.joints).cwiseAbs().maxCoeff() - 1e-12) /
                                         (limits_.max_angular_acceleration_radps2 * from_rest_s), 1e-6);
      }
      if (now.joints.size() > 0 || before.joints.size() > 0) continue;
      const double from_rest_s = before.twist.isZero() ? std::max(dt, 0.008) : dt;
      atMost("acceleration", ((now.twist.linear_mps - before.twist.linear_mps).norm() - 1e-12) /
                                 (limits_.max_acceleration_mps2 * from_rest_s), 1e-6);
    }
  }
  void add(const Violations& other) {
    travelled_m += other.travelled_m;
    for (const auto& [name, breach] : other.breaches) {
      Breach& mine = breaches[name];
      const int count = mine.count + breach.count;
      if (mine.count == 0 || breach.times > mine.times) mine = breach;
      mine.count = count;
    }
  }
  std::string text() const {
    std::ostringstream all;
    for (const auto& [name, breach] : breaches)
      all << name << ": " << breach.count << ", worst " << breach.times << " times the limit in sequence "
          << breach.sequence << " at q = " << breach.q.transpose() << "; ";
    return all.str();
  }
  std::map<std::string, Breach> breaches;
  double travelled_m = 0.0;

 private:
  void note(const char* name, double times = 0.0) {
    Breach& breach = breaches[name];
    if (breach.count++ == 0 || times > breach.times)
      breach = {breach.count, times, sequence_, q_};
  }
  void atMost(const char* name, double times, double tolerance) {
    if (times > 1.0 + tolerance) note(name, times);
  }

  const Kinematics& kinematics_;
  MotionLimits limits_;
  CollisionModel links_;
  double tolerance_, tolerance_m_;
  int sequence_;
  Eigen::VectorXd q_;
  std::vector<Eigen::Vector3d> corners_e_, points_e_;
  RobotState last_;
};

struct Adversary {
  std::mt19937_64 random;
  Twist<Base> habit{};
  std::optional<Eigen::VectorXd> joint_habit;  // Instead of the twist.
  int persistence = 0;

  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }
  Eigen::Vector3d direction() {
    std::normal_distribution<double> normal;
    const double x = normal(random), y = normal(random), z = normal(random);
    return Eigen::Vector3d(x, y, z).normalized();
  }
  // Now and then something new: anything from a creep to nonsense, often straight at an obstacle.
  Twist<Base> twist(const RobotState& state, const MotionLimits& limits) {
    if (persistence-- > 0) return habit;
    persistence = static_cast<int>(uniform(0, 60));
    joint_habit.reset();
    if (uniform(0, 1) < 0.4) {  // One joint, or all of them; or straight to a fold.
      joint_habit = Eigen::VectorXd::Zero(6);
      const double most = std::pow(10.0, uniform(-2.0, 1.0));
      if (uniform(0, 1) < 0.5) (*joint_habit)[static_cast<Eigen::Index>(uniform(0, 5.999))] = uniform(-most, most);
      else for (double& speed : *joint_habit) speed = uniform(-most, most);
      if (uniform(0, 1) < 0.3) (*joint_habit)[2] = std::copysign(most, state.q[2]);
      if (uniform(0, 1) < 0.02) (*joint_habit)[1] = std::numeric_limits<double>::quiet_NaN();
      return habit;
    }
    const double linear = std::pow(10.0, uniform(-3.0, 1.0)), angular = std::pow(10.0, uniform(-3.0, 1.0));
    habit = {linear * direction(), angular * direction()};
    const int kind = static_cast<int>(uniform(0, 8));
    if (kind <= 2) {
      const Box& box = limits.keep_out[static_cast<std::size_t>(uniform(0, 2.999))];
      habit.linear_mps = linear * (0.5 * (box.min_m + box.max_m) - state.bMe.translation()).normalized();
    } else if (kind == 3) {
      habit.angular_radps.setZero();
    } else if (kind == 4) {
      habit.linear_mps.setZero();
    } else if (kind == 5 && uniform(0, 1) < 0.2) {
      habit.linear_mps.x() = uniform(0, 1) < 0.5 ? std::numeric_limits<double>::quiet_NaN() : kHuge;
      persistence = 0;
    }
    return habit;
  }
};

// Runs sequences of commands from different starts; the guard obeys `guarded` and, if asked, watches the links;
// the count is against cellLimits().
Violations run(const MotionLimits& guarded, bool watch_links, int sequences, const FakeArmOptions& fake,
               double tolerance, double tolerance_m) {
  const Kinematics kinematics{ArmConfig{}};
  CellConfig cell;
  cell.limits = cellLimits();
  const auto eMo = Pose<EndEffector, Board>::fromRotationVector({3.0, 0.1, -0.15}, {0.02, -0.03, 0.04});
  Violations violations(kinematics, cell.limits, cell.board, eMo, tolerance, tolerance_m);
  std::vector<int> all(std::begin(kOnceBroke), std::end(kOnceBroke));
  for (int sequence = 0; sequence < sequences; ++sequence) all.push_back(sequence);
  for (const int sequence : all) {
    Adversary adversary{std::mt19937_64(2024 + static_cast<unsigned>(sequence)), {}, {}};
    SimulatedClock clock;
    Eigen::VectorXd q(6);
    std::unique_ptr<FakeArm> arm = std::make_unique<FakeArm>(kinematics, clock, Eigen::VectorXd::Zero(6), fake);
    Guard probe(*arm, kinematics, clock, cell);
    probe.setBoard(eMo);
    do {  // A start that obeys the limits.
      for (double& angle : q) angle = adversary.uniform(-3.0, 3.0);
      if (adversary.uniform(0, 1) < 0.2) q[5] = adversary.uniform(5.9, 6.2);
    } while (!probe.allows(q));
    FakeArm moved(kinematics, clock, q, fake);
    Violations spell(kinematics, cell.limits, cell.board, eMo, tolerance, tolerance_m, sequence);
    moved.on_step = [&](const RobotState& state) { spell.watch(state); };
    std::unique_ptr<Guard> guard;
    if (watch_links) {
      CellConfig watched = cell;
      watched.limits = guarded;
      guard = std::make_unique<Guard>(moved, kinematics, clock, watched);
    } else {
      guard = std::make_unique<Guard>(moved, kinematics, clock, guarded, cell.board);
    }
    guard->setBoard(eMo);
    for (int i = 0; i < kCommands; ++i) {
      std::optional<Instant> seen;
      if (adversary.uniform(0, 1) < 0.5) seen = clock.now() - fromSeconds(adversary.uniform(-0.001, 0.155));
      const Twist<Base> twist = adversary.twist(moved.state(), cell.limits);
      if (adversary.joint_habit) (void)guard->commandJoints(*adversary.joint_habit, seen);
      else (void)guard->command(twist, seen);
      const double luck = adversary.uniform(0, 1);
      clock.sleepFor(fromSeconds(luck < 0.7 ? 0.008 : luck < 0.97 ? adversary.uniform(0.0, 0.04) : adversary.uniform(0.0, 0.25)));
      moved.state();
    }
    spell.watchAcceleration(moved);
    violations.add(spell);
  }
  return violations;
}

TEST(GuardProperty, NoCommandBreaksAnyLimitOfAnIdealArm) {
  const Violations found = run(cellLimits(), true, kSequences, {}, 1e-6, 1e-9);
  EXPECT_TRUE(found.breaches.empty()) << found.text();
  EXPECT_GT(found.travelled_m, 5.0);  // It was not for standing still.
}

// An arm that follows 30 ms late (first order) cuts the corners of every path; look_ahead allows for it.
TEST(GuardProperty, NoCommandBreaksALimitOfALaggingArm) {
  FakeArmOptions lagging;
  lagging.lag_s = 0.03;
  const Violations found = run(cellLimits(), true, kSequences / 3, lagging, 0.03, 0.001);
  EXPECT_TRUE(found.breaches.empty()) << found.text();
}

// Negative control: the same commands break every limit when nothing guards it.
TEST(GuardProperty, TheSameCommandsBreakEveryLimitUnguarded) {
  MotionLimits open;
  open.workspace = {"workspace", Eigen::Vector3d::Constant(-kHuge), Eigen::Vector3d::Constant(kHuge)};
  open.max_speed_mps = open.max_angular_speed_radps = open.max_joint_speed_radps = 3.0;
  open.max_acceleration_mps2 = open.max_angular_acceleration_radps2 = kHuge;
  open.joint_margin_rad = 0.0;
  const Violations found = run(open, false, 100, {}, 1e-6, 1e-9);
  for (const char* name : {"flange speed", "angular speed", "corner speed", "joint limit", "joint speed", "workspace",
                           "keep-out", "acceleration", "joint acceleration", "links"})
    EXPECT_EQ(found.breaches.count(name), 1u) << name;
}

}  // namespace
}  // namespace servocal::robot
