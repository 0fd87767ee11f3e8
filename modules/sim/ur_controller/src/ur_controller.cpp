// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sim_ur_controller/ur_controller.h"

#include <poll.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

#include "controller_state.h"
#include "rtde_server.h"
#include "text_servers.h"

namespace servocal::sim {
namespace {

using SteadyClock = std::chrono::steady_clock;

// How the controller brakes on its own: a program that ended, and a stop for safety.
constexpr double kStopRadps2 = 5.0;
constexpr double kHardStopRadps2 = 15.0;
// A controller is never late; where this computer is, steps are made up for, up to this many. Beyond, the
// controller's time stands still, else its watchdogs would punish the client for this computer's load.
constexpr int kMostStepsAtOnce = 5;
constexpr int kFirstFreeRegister = 24;

/// What programs may do to the controller.
class Host final : public ScriptHost {
 public:
  explicit Host(ControllerState& state) : state_(state) {}

  double stepTime() const override { return state_.period(); }
  int inputInteger(int index) const override {
    const auto value = state_.input_integers.find(index);
    return value == state_.input_integers.end() ? 0 : value->second;
  }
  double inputFloat(int index) const override {
    const auto value = state_.input_floats.find(index);
    return value == state_.input_floats.end() ? 0.0 : value->second;
  }
  void outputInteger(int index, int value) override {
    if (index < kFirstFreeRegister || index > 47) throw std::out_of_range("output register");
    state_.output_integers[index] = value;
  }
  void setWatchdog(const std::string& variable, double least_hz, const std::string& action) override {
    state_.watchdogs.push_back({variable, 1.0 / least_hz, action, state_.time_s});
  }
  void textMessage(const std::string& text) override { state_.messages.push_back(keyMessage("", text)); }
  void speedl(const Vector6d& twist, double acceleration, double angular_acceleration) override {
    state_.arm.speedl(twist, acceleration, angular_acceleration);
  }
  void speedj(const Vector6d& speeds, double acceleration) override {
    state_.arm.speedj(speeds, acceleration);
  }
  void stopl(double acceleration, double angular_acceleration) override {
    state_.arm.stopl(acceleration, angular_acceleration);
  }
  void stopj(double acceleration) override { state_.arm.stopj(acceleration); }
  bool stands() const override { return state_.arm.stands(); }

 private:
  ControllerState& state_;
};

}  // namespace

struct UrController::Impl {
  explicit Impl(const UrControllerOptions& options) : state(options) {
    thread = std::thread([this] { run(); });
  }
  ~Impl() {
    quit = true;
    thread.join();
  }

  void run() {
    const auto period =
        std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(state.period()));
    SteadyClock::time_point due = SteadyClock::now() + period;
    while (!quit) {
      waitUntil(due);
      const std::lock_guard<std::mutex> lock(mutex);
      rtde.serve();
      dashboard.serve();
      if (const std::string program = primary.serve(); !program.empty()) start(program);
      for (int steps = 0; SteadyClock::now() >= due && steps < kMostStepsAtOnce; ++steps) {
        if (steps > 0) rtde.serve();
        step();
        if (state.options.on_step) state.options.on_step({due, state.arm.q(), state.arm.flange()});
        due += period;
      }
      while (SteadyClock::now() >= due + period) {
        due += period;
        ++late_steps;
      }
    }
  }

  void waitUntil(SteadyClock::time_point due) {
    std::vector<pollfd> waited;
    const auto add = [&](const std::vector<int>& descriptors) {
      for (const int descriptor : descriptors) waited.push_back({descriptor, POLLIN, 0});
    };
    add(rtde.descriptors());
    add(dashboard.descriptors());
    add(primary.descriptors());
    const auto left = std::chrono::duration_cast<std::chrono::nanoseconds>(due - SteadyClock::now()).count();
    const timespec limit{0, std::clamp<long>(static_cast<long>(left), 0, 999999999)};
    ::ppoll(waited.data(), waited.size(), &limit, nullptr);
  }

  void endProgram() {
    if (!state.program) return;
    state.messages.push_back(keyMessage("PROGRAM_XXX_STOPPED", state.program->name()));
    state.program.reset();
    state.watchdogs.clear();
    state.arm.stopj(kStopRadps2);
  }

  void report(const ScriptFault& fault) { state.messages.push_back(runtimeException(fault)); }

  void start(std::string text) {
    endProgram();
    if (state.stoppedForSafety()) return;
    if (state.options.edit_program) text = state.options.edit_program(text);
    state.program_text = text;
    state.watchdog_struck = false;
    try {
      state.program = std::make_unique<ScriptMachine>(parseScript(text));
      state.messages.push_back(keyMessage("PROGRAM_XXX_STARTED", state.program->name()));
    } catch (const ScriptFault& fault) {
      report(fault);
    }
  }

  void feedWatchdogs() {
    for (auto& watchdog : state.watchdogs) {
      if (state.fresh_inputs.count(watchdog.variable) > 0) watchdog.fed_s = state.time_s;
    }
    state.fresh_inputs.clear();
    const bool starved =
        std::any_of(state.watchdogs.begin(), state.watchdogs.end(), [&](const auto& watchdog) {
          return watchdog.action == "stop" && state.time_s - watchdog.fed_s > watchdog.period_s + 1e-9;
        });
    if (!starved) return;
    state.watchdog_struck = true;
    endProgram();
  }

  void step() {
    state.time_s += state.period();
    feedWatchdogs();
    if (state.has(UrFault::kProgramStopped)) endProgram();
    if (state.has(UrFault::kOtherProgram)) {
      state.faults.erase(UrFault::kOtherProgram);
      start("def other():\n  while True:\n    sync()\n  end\nend\n");
    }
    if (state.program && !state.paused()) {
      try {
        Host host(state);
        state.program->step(host);
        if (state.program->ended()) endProgram();
      } catch (const ScriptFault& fault) {
        report(fault);
        endProgram();
      } catch (const std::out_of_range&) {
        report(ScriptFault(0, 0, "Value error: no such register"));
        endProgram();
      }
    }
    // A pause brakes along the path and lets go of it again when the program goes on.
    path_share +=
        std::clamp((state.paused() ? 0.0 : 1.0) - path_share, -state.period() / 0.1, state.period() / 0.1);
    if (state.stoppedForSafety()) state.arm.stopj(kHardStopRadps2);
    state.arm.step(state.period(), (state.stoppedForSafety() ? 1.0 : path_share) * state.slider());
    if (state.arm.overran()) state.faults.insert(UrFault::kProtectiveStop);
    if (!state.arm.stands()) state.last_motion_s = state.time_s;
    rtde.publish();
    primary.publish();
  }

  mutable std::mutex mutex;  // Guards everything below against the tests' questions.
  ControllerState state;
  RtdeServer rtde{state};
  DashboardServer dashboard{state};
  PrimaryServer primary{state};
  double path_share = 1.0;
  std::size_t late_steps = 0;
  std::atomic<bool> quit{false};
  std::thread thread;
};

UrController::UrController(const UrControllerOptions& options) : impl_(std::make_unique<Impl>(options)) {}
UrController::~UrController() = default;
int UrController::rtdePort() const { return impl_->rtde.listener().port(); }
int UrController::dashboardPort() const { return impl_->dashboard.listener().port(); }
int UrController::programPort() const { return impl_->primary.listener().port(); }

void UrController::misbehave(UrFault fault) {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  impl_->state.faults.insert(fault);
}

void UrController::behave() {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  impl_->state.faults.clear();
}

UrControllerTruth UrController::truth() const {
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  const ControllerState& state = impl_->state;
  UrControllerTruth truth;
  truth.time_s = state.time_s;
  truth.q = state.arm.q();
  truth.flange = state.arm.flange();
  truth.tcp_speed_mps = state.arm.tcpSpeed().head<3>().norm();
  truth.joint_speed_radps = state.arm.speeds().cwiseAbs().maxCoeff();
  truth.program_runs = state.program != nullptr;
  truth.program_text = state.program_text;
  truth.watchdog_struck = state.watchdog_struck;
  truth.last_input_s = state.last_input_s;
  truth.last_moving_input_s = state.last_moving_input_s;
  truth.last_motion_s = state.last_motion_s;
  truth.late_steps = impl_->late_steps;
  return truth;
}

}  // namespace servocal::sim
