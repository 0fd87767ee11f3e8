// SPDX-License-Identifier: GPL-3.0-or-later
#include "simulated_arm.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "servocal/core/error.h"
#include "ur5.h"

namespace servocal::sim {
namespace {

constexpr Duration kTick = std::chrono::milliseconds(2);
constexpr int kTicksPerReport = 4;            // 125 Hz, as a CB3 controller.
constexpr std::int64_t kHistoryTicks = 1500;  // 3 s; callers may rely on 2 s.
constexpr double kEncoderNoiseRad = 5e-6;
// Below this |det J| the inverse is damped (Nakamura & Hanafusa 1986). The default cell's start has 0.04.
constexpr double kDampedBelow = 0.004;
constexpr double kDamping = 0.05;

Instant timeOf(std::int64_t index) { return Instant(kTick * index); }
std::int64_t lastTick(Instant instant) { return instant.time_since_epoch() / kTick; }

// Six joints are worked out in fixed sizes: a seed of the UR5 stays the same run to the last bit.
Vector6d twistOf(const ArmJacobian& jacobian, const Joints& speed) {
  if (speed.size() != 6) return jacobian * speed;
  return Matrix6d(jacobian) * Vector6d(speed);
}

double lengthOf(const Joints& step) { return step.size() == 6 ? Vector6d(step).norm() : step.norm(); }

Joints dampedSolution(const ArmJacobian& jacobian, double closeness, const Vector6d& twist) {
  const double damping = kDamping * closeness;
  const Matrix6d squared = jacobian * jacobian.transpose() + damping * damping * Matrix6d::Identity();
  return jacobian.transpose() * squared.partialPivLu().solve(twist);
}

}  // namespace

SimulatedArm::SimulatedArm(const SimulatedClock& clock, const CellConfig& config, std::uint64_t seed)
    : clock_(clock), nominal_(makeArmChain(config.arm)), real_(realArm(*nominal_, config, seed)),
      repeatability_(drawRepeatability(*config.simulation, seed)),
      max_speed_radps_(config.simulation->max_joint_speed_radps),
      max_acceleration_radps2_(config.simulation->max_joint_acceleration_radps2),
      noise_seed_(Random(seed, "encoders").bits()) {
  info_ = {nominal_->name() + " (simulated)", "sim-" + std::to_string(seed), nominal_->joints(),
           500.0 / kTicksPerReport};
  const Eigen::VectorXd& start_q = config.arm.start_q;
  if (start_q.size() != nominal_->joints() || !start_q.allFinite() ||
      (start_q.array() < nominal_->lower().array()).any() ||
      (start_q.array() > nominal_->upper().array()).any()) {
    throw std::invalid_argument("sim::Cell: arm.start_q must be " + std::to_string(nominal_->joints()) +
                                " joint angles within the joint limits");
  }
  Random random(seed, "arm clock");
  device_clock_offset_s_ = random.uniform(100.0, 10000.0);
  Tick first;
  first.q = start_q;
  first.speed = Joints::Zero(start_q.size());
  // So that the first visit has an error of its own too.
  first.travelled_rad = random.uniform(0.0, 100.0);
  first.index = lastTick(clock.now());
  ticks_.push_back(first);
}

void SimulatedArm::catchUp() {
  const std::int64_t last = lastTick(clock_.now());
  while (ticks_.back().index < last) step();
}

Joints SimulatedArm::wantedSpeed(Instant instant) const {
  const Joints& q = ticks_.back().q;
  if (instant >= command_end_ || protective_stop_) return Joints::Zero(q.size());
  if (joint_command_) return Joints(joint_command_->cwiseMax(-max_speed_radps_).cwiseMin(max_speed_radps_));
  if (command_.isZero()) return Joints::Zero(q.size());
  Vector6d twist;
  twist << command_.linear_mps, command_.angular_radps;
  const ArmJacobian jacobian = nominal_->jacobian(q);
  Joints speed;
  if (q.size() == 6) {
    const Matrix6d square = jacobian;
    const double closeness = 1.0 - std::abs(square.determinant()) / kDampedBelow;
    speed = closeness <= 0.0 ? Joints(square.partialPivLu().solve(twist))
                             : dampedSolution(jacobian, closeness, twist);
  } else {  // The smallest joint speeds that do it; with fewer than six joints, the best there are.
    const Matrix6d squared = jacobian * jacobian.transpose();
    const double volume = std::sqrt(std::max(0.0, squared.determinant()));
    speed = dampedSolution(jacobian, std::max(0.0, 1.0 - volume / kDampedBelow), twist);
  }
  const double fastest = speed.cwiseAbs().maxCoeff();
  if (fastest > max_speed_radps_) speed *= max_speed_radps_ / fastest;
  return speed;
}

void SimulatedArm::step() {
  const Tick& last = ticks_.back();
  const double dt = toSeconds(kTick);
  Tick next;
  next.index = last.index + 1;
  Joints change = wantedSpeed(timeOf(last.index)) - last.speed;
  const double largest = change.cwiseAbs().maxCoeff();
  if (largest > max_acceleration_radps2_ * dt) change *= max_acceleration_radps2_ * dt / largest;
  next.speed = last.speed + change;
  next.q = last.q + 0.5 * dt * (last.speed + next.speed);
  for (int joint = 0; joint < nominal_->joints(); ++joint) {
    const double low = nominal_->lower()[joint], high = nominal_->upper()[joint];
    if (next.q[joint] >= low && next.q[joint] <= high) continue;
    if (!protective_stop_) {
      std::ostringstream message;
      message << "The simulated arm made a protective stop at " << toSeconds(timeOf(next.index))
              << " s: joint " << joint + 1 << " reached its limit of " << (next.q[joint] < low ? low : high)
              << " rad. Start the run again from a pose farther from the joint limits.";
      protective_stop_ = message.str();
    }
    next.q = last.q;
    next.speed.setZero();
    break;
  }
  next.travelled_rad = last.travelled_rad + lengthOf(next.q - last.q);
  ticks_.push_back(next);
  if (static_cast<std::int64_t>(ticks_.size()) > kHistoryTicks) ticks_.pop_front();
}

const SimulatedArm::Tick& SimulatedArm::stored(std::int64_t index) const {
  const std::int64_t clamped = std::clamp(index, ticks_.front().index, ticks_.back().index);
  return ticks_[static_cast<std::size_t>(clamped - ticks_.front().index)];
}

SimulatedArm::Tick SimulatedArm::tickAt(Instant instant) {
  catchUp();
  const std::int64_t index = lastTick(instant);
  const Tick& before = stored(index);
  const Tick& after = stored(index + 1);
  const double weight =
      before.index == after.index ? 0.0 : toSeconds(instant - timeOf(index)) / toSeconds(kTick);
  Tick tick = before;
  tick.q += weight * (after.q - before.q);
  tick.speed += weight * (after.speed - before.speed);
  tick.travelled_rad += weight * (after.travelled_rad - before.travelled_rad);
  return tick;
}

Joints SimulatedArm::jointsAt(Instant instant) { return tickAt(instant).q; }

std::vector<Eigen::Isometry3d> SimulatedArm::nominalFrames(Instant instant) {
  return nominal_->frames(jointsAt(instant));
}

Eigen::Isometry3d SimulatedArm::flangeAt(Instant instant) {
  const Tick tick = tickAt(instant);
  return repeatability_.apply(real_->forward(tick.q), tick.travelled_rad);
}

RobotState SimulatedArm::report(const Tick& tick) const {
  // Noise is a function of the tick, so that reading twice, or not at all, changes nothing.
  Joints q = tick.q;
  Random noise(noise_seed_ ^ scramble(static_cast<std::uint64_t>(tick.index)), "");
  for (double& angle : q) angle += kEncoderNoiseRad * noise.normal();
  const Vector6d twist = twistOf(nominal_->jacobian(q), tick.speed);
  RobotState state;
  state.stamp = timeOf(tick.index);
  state.device_stamp_s = toSeconds(state.stamp) + device_clock_offset_s_;
  state.q = q;
  state.bMe = Pose<Base, EndEffector>(nominal_->forward(q));
  state.twist = {twist.head<3>(), twist.tail<3>()};
  return state;
}

RobotState SimulatedArm::reportAt(std::int64_t index) const { return report(stored(index)); }

RobotState SimulatedArm::state() {
  catchUp();
  if (protective_stop_) throw Error(ErrorKind::kSafetyStop, *protective_stop_);
  return reportAt(ticks_.back().index / kTicksPerReport * kTicksPerReport);
}

RobotState SimulatedArm::stateAt(Instant stamp) {
  catchUp();
  const std::int64_t newest = ticks_.back().index / kTicksPerReport * kTicksPerReport;
  const std::int64_t oldest =
      (ticks_.front().index + kTicksPerReport - 1) / kTicksPerReport * kTicksPerReport;
  const std::int64_t before = lastTick(stamp) / kTicksPerReport * kTicksPerReport;
  if (before >= newest) return reportAt(newest);
  if (stamp < timeOf(oldest)) return reportAt(oldest);
  const RobotState first = reportAt(before);
  const RobotState second = reportAt(before + kTicksPerReport);
  const double weight = toSeconds(stamp - first.stamp) / toSeconds(second.stamp - first.stamp);
  RobotState state = first;
  state.stamp = stamp;
  state.device_stamp_s = toSeconds(stamp) + device_clock_offset_s_;
  state.q += weight * (second.q - first.q);
  state.bMe = Pose<Base, EndEffector>(nominal_->forward(state.q));
  state.twist.linear_mps += weight * (second.twist.linear_mps - first.twist.linear_mps);
  state.twist.angular_radps += weight * (second.twist.angular_radps - first.twist.angular_radps);
  return state;
}

void SimulatedArm::move(robot::MotionKey, const Twist<Base>& twist, Duration valid_for) {
  if (!twist.isFinite()) throw std::invalid_argument("SimulatedArm::move: the twist is not finite");
  catchUp();
  command_ = twist;
  joint_command_.reset();
  command_end_ = clock_.now() + valid_for;
}

void SimulatedArm::moveJoints(robot::MotionKey, const Eigen::VectorXd& speeds_radps, Duration valid_for) {
  if (speeds_radps.size() != ticks_.back().q.size() || !speeds_radps.allFinite())
    throw std::invalid_argument("SimulatedArm::moveJoints: expected one finite speed per joint");
  catchUp();
  joint_command_ = Joints(speeds_radps);
  command_end_ = clock_.now() + valid_for;
}

void SimulatedArm::stop(robot::MotionKey) {
  catchUp();
  command_ = {};
  joint_command_.reset();
}

}  // namespace servocal::sim
