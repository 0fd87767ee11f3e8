// SPDX-License-Identifier: GPL-3.0-or-later
#include "link.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

namespace servocal::robot::ur {
namespace {

constexpr std::size_t kMostMessages = 100;
constexpr std::int32_t kHeartbeatWraps = 1 << 30;
// Two packages in a row are one gap apart; more than this many are a missed one.
constexpr double kGap = 1.5;

Error staleError(Duration age) {
  return Error(
      ErrorKind::kHardwareAbsent,
      "The controller sent no state for " + std::to_string(age / std::chrono::milliseconds(1)) +
          " ms. The link was given up; the controller's watchdog stops the arm. Check cable and switch, "
          "then start again.");
}

}  // namespace

Eigen::Isometry3d fromVector(const Vector6d& pose) {
  return Pose<Base, Tcp>::fromRotationVector(pose.tail<3>(), pose.head<3>()).isometry();
}

Link::Link(RtdeClient client, Clock& clock, const ArmOptions& options, const ControllerState& first)
    : client_(std::move(client)), clock_(clock), options_(options),
      tcpMe_(fromVector(first.tcp_offset).inverse()), period_s_(1.0 / client_.rateHz()),
      wake_descriptor_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  expected_.tcp_offset = first.tcp_offset;
  expected_.payload_kg = first.payload_kg;
  expected_.watchdog_s = toSeconds(options.watchdog);
  accept(first, clock_.now());
  thread_ = std::thread([this] { run(); });
}

Link::~Link() {
  quit_ = true;
  wake();
  thread_.join();
  ::close(wake_descriptor_);
}

void Link::wake() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(wake_descriptor_, &one, sizeof one);
}

void Link::command(const Command& command) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    command_ = command;
  }
  wake();
}

void Link::expect(const Expected& expected) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    expected_ = expected;
  }
  wake();
}

void Link::announce(int epoch) {
  const std::lock_guard<std::mutex> lock(mutex_);
  epoch_ = epoch;
}

void Link::forgetStop() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (dead_) return;
  stop_.reset();
  exception_.reset();
  expected_.token = 0;
  expected_.epoch = 0;
  command_ = {};
}

void Link::watchProgram(Socket primary) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    new_primary_.emplace(std::move(primary));
  }
  wake();
}

std::optional<Error> Link::stopped() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return stop_;
}

ControllerState Link::newest() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return newest_;
}

RobotState Link::state() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (stop_) throw *stop_;
  // The thread gives up on its own; this is for the case that the thread itself gets no time.
  const Duration age = clock_.now() - history_.newest().stamp;
  if (age > 3 * options_.dead_peer) throw staleError(age);
  return history_.newest();
}

RobotState Link::stateAt(Instant stamp) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (dead_) throw *stop_;
  return history_.at(stamp);
}

LinkReport Link::report() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return report_;
}

Expected Link::expected() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return expected_;
}

std::optional<ProgramMessage> Link::takeException() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::exchange(exception_, std::nullopt);
}

RobotState Link::toRobotState(const ControllerState& state, Instant stamp) const {
  const Eigen::Isometry3d bMtcp = fromVector(state.actual_tcp_pose);
  RobotState result;
  result.stamp = stamp;
  result.device_stamp_s = state.timestamp_s;
  result.q = state.actual_q;
  result.bMe = Pose<Base, EndEffector>(bMtcp * tcpMe_);
  result.twist.angular_radps = state.actual_tcp_speed.tail<3>();
  const Eigen::Vector3d from_tcp = result.bMe.translation() - bMtcp.translation();
  result.twist.linear_mps = state.actual_tcp_speed.head<3>() + result.twist.angular_radps.cross(from_tcp);
  return result;
}

void Link::note(const std::string& message) {
  if (report_.messages.size() >= kMostMessages) report_.messages.erase(report_.messages.begin());
  report_.messages.push_back(message);
}

void Link::accept(const ControllerState& state, Instant arrival) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (report_.states > 0) {
    const double step_s = state.timestamp_s - newest_.timestamp_s;
    if (step_s < 0.0) {
      failProtocol("its clock ran backwards by " + std::to_string(-step_s) + " s");
    }
    if (step_s < 0.5 * period_s_) {
      ++report_.repeated;
      return;
    }
    if (step_s > kGap * period_s_)
      report_.missed += static_cast<std::size_t>(std::lround(step_s / period_s_)) - 1;
    report_.longest_gap = std::max(report_.longest_gap, arrival - last_arrival_);
  }
  ++report_.states;
  report_.speed_slider_min = std::min(report_.speed_slider_min, state.speed_slider);
  report_.speed_slider_max = std::max(report_.speed_slider_max, state.speed_slider);
  report_.safety_mode = state.safety_mode;
  report_.robot_mode = state.robot_mode;
  last_arrival_ = arrival;
  if (state.script_beat != newest_.script_beat) echo_stamp_s_ = state.timestamp_s;
  newest_ = state;
  history_.push(toRobotState(state, stamps_.map(state.timestamp_s, arrival)));
  if (stop_) return;
  if (auto reason = objection(state, expected_, state.timestamp_s - echo_stamp_s_)) {
    if (exception_) *reason += " The controller says: " + exception_->toString() + ".";
    stop_.emplace(ErrorKind::kSafetyStop, *reason);
  }
}

Command Link::current(Instant now) const {
  if (command_.mode == ScriptMode::kEnd) return command_;
  if (stop_ || expected_.epoch == 0 || now >= command_.until) return {};
  return command_;
}

void Link::sendBeat(Instant now) {
  ScriptInput input;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const Command command = current(now);
    input.mode = command.mode;
    input.velocity = command.velocity;
    input.epoch = epoch_;
  }
  heartbeat_ = (heartbeat_ + 1) % kHeartbeatWraps;
  input.heartbeat = heartbeat_;
  client_.send(input);
  last_beat_ = now;
}

void Link::readProgramMessages() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (new_primary_) {
      primary_.reset();
      primary_.emplace(std::move(*new_primary_));
      new_primary_.reset();
      primary_reader_ = PrimaryReader();
    }
  }
  if (!primary_) return;
  try {
    const Bytes bytes = primary_->receive(Duration::zero());
    primary_reader_.feed(bytes.data(), bytes.size());
    while (const auto message = primary_reader_.next()) {
      const std::lock_guard<std::mutex> lock(mutex_);
      note(message->toString());
      if (message->kind == ProgramMessage::Kind::kRuntimeException) exception_ = *message;
    }
  } catch (const Error& error) {  // Only news come this way; what the arm does, RTDE says.
    primary_.reset();
    const std::lock_guard<std::mutex> lock(mutex_);
    note(error.what());
  }
}

void Link::waitForNews(Duration longest) const {
  pollfd waited[3] = {{client_.descriptor(), POLLIN, 0},
                      {wake_descriptor_, POLLIN, 0},
                      {primary_ ? primary_->descriptor() : -1, POLLIN, 0}};
  const auto nanoseconds = std::clamp<Duration::rep>(longest.count(), 0, 1000000000);
  const timespec limit{static_cast<time_t>(nanoseconds / 1000000000),
                       static_cast<long>(nanoseconds % 1000000000)};
  ::ppoll(waited, 3, &limit, nullptr);
}

void Link::turn() {
  Instant now = clock_.now();
  Instant next = std::min(last_arrival_ + options_.dead_peer, last_beat_ + options_.watchdog / 4);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const Command command = current(now);
    if (command.mode == ScriptMode::kTwist || command.mode == ScriptMode::kJoints)
      next = std::min(next, command.until);
  }
  waitForNews(next - now);
  std::uint64_t count = 0;
  const bool woken = ::read(wake_descriptor_, &count, sizeof count) > 0;
  readProgramMessages();

  const std::vector<ControllerState> states = client_.receive();
  now = clock_.now();
  for (const ControllerState& state : states) accept(state, now);
  for (const TextMessage& message : client_.takeMessages()) {
    const std::lock_guard<std::mutex> lock(mutex_);
    note(message.source + ": " + message.text);
  }
  if (now - last_arrival_ >= options_.dead_peer) {
    const std::lock_guard<std::mutex> lock(mutex_);
    report_.silence = now - last_arrival_;
    throw staleError(now - last_arrival_);
  }
  if (!states.empty() || woken || now >= next) sendBeat(now);
}

void Link::run() {
  try {
    while (!quit_) turn();
  } catch (const Error& error) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stop_ = error;
      dead_ = true;
    }
    try {  // Perhaps the other side still listens.
      sendBeat(clock_.now());
    } catch (const Error&) {
    }
  }
}

}  // namespace servocal::robot::ur
