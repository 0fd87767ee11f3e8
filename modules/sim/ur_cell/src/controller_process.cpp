// SPDX-License-Identifier: GPL-3.0-or-later
#include "controller_process.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <new>
#include <thread>

#include "servocal/core/error.h"
#include "servocal/sim_ur_controller/ur_controller.h"

namespace servocal::sim {
namespace {

constexpr std::chrono::seconds kStandsWithin(10);

struct Ports {
  int rtde = 0, dashboard = 0, program = 0;
};

UrControllerOptions optionsFor(const ArmConfig& arm, std::uint64_t seed, MotionRecord& record) {
  UrControllerOptions options;
  options.serial = arm.ur->serial;
  options.start_q = arm.start_q;
  options.seed = seed;
  // A tool is active, as on most arms; the driver must take it off.
  options.tcp_offset =
      Eigen::Translation3d(0.010, -0.005, 0.100) * Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX());
  options.on_step = [&record](const UrStep& step) {
    MotionStep kept;
    kept.steady_ns = std::chrono::nanoseconds(step.due.time_since_epoch()).count();
    Eigen::Map<Eigen::Matrix<double, 6, 1>> q(kept.q);
    q = step.q;
    Eigen::Map<Eigen::Vector3d>(kept.position_m) = step.flange.translation();
    Eigen::Map<Eigen::Quaterniond>(kept.quaternion) = Eigen::Quaterniond(step.flange.linear());
    if (const std::uint64_t before = record.size(); before > 0) {
      const MotionStep& last = record.step(before - 1);
      const Eigen::Map<const Eigen::Matrix<double, 6, 1>> last_q(last.q);
      kept.travelled_rad = last.travelled_rad + (q - last_q).norm();
    }
    record.push(kept);
  };
  return options;
}

/// The program that moved the arm is gone. Says what became of the arm, if that is worth a word.
void outlive(const UrController& controller) {
  if (!controller.truth().program_runs) return;
  const auto give_up = std::chrono::steady_clock::now() + kStandsWithin;
  while (controller.truth().joint_speed_radps > 0.0 && std::chrono::steady_clock::now() < give_up)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  const UrControllerTruth truth = controller.truth();
  if (truth.joint_speed_radps > 0.0) {
    std::fputs("Simulated controller: its program is gone and the arm moves on.\n", stderr);
    return;
  }
  const double moved_s = truth.last_motion_s - truth.last_moving_input_s;
  std::fprintf(stderr,
               "Simulated controller: the program that moved the arm is gone; the arm stood still %.0f ms "
               "after its last command.\n",
               1e3 * std::max(0.0, moved_s));
}

/// Never returns.
[[noreturn]] void runController(const ArmConfig& arm, std::uint64_t seed, MotionRecord& record,
                                int lifeline) {
  ::setsid();  // Ctrl-C and a closed terminal are for the program, not for the robot's controller.
  const int nowhere = ::open("/dev/null", O_RDWR);
  ::dup2(nowhere, STDIN_FILENO);
  ::dup2(nowhere, STDOUT_FILENO);
  // Nothing of the program's stays open here: neither its files nor the locks on them.
  constexpr int kLifeline = STDERR_FILENO + 1;
  ::dup2(lifeline, kLifeline);
  ::close_range(kLifeline + 1, ~0U, 0);
  lifeline = kLifeline;
  try {
    const UrController controller(optionsFor(arm, seed, record));
    while (record.size() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const Ports ports{controller.rtdePort(), controller.dashboardPort(), controller.programPort()};
    if (::send(lifeline, &ports, sizeof ports, MSG_NOSIGNAL) == static_cast<ssize_t>(sizeof ports)) {
      char nothing = 0;
      while (::recv(lifeline, &nothing, 1, 0) < 0 && errno == EINTR) {
      }
      outlive(controller);
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "Simulated controller: %s\n", error.what());
  }
  ::_exit(0);
}

[[noreturn]] void fail(const std::string& what) {
  throw Error(ErrorKind::kHardwareAbsent, "The simulated controller does not start: " + what + ".");
}

}  // namespace

ControllerProcess::ControllerProcess(const ArmConfig& arm, std::uint64_t seed) {
  void* const memory =
      ::mmap(nullptr, sizeof(MotionRecord), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) fail(std::strerror(errno));
  record_ = new (memory) MotionRecord;
  int ends[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) fail(std::strerror(errno));
  process_ = ::fork();
  if (process_ == 0) {
    ::close(ends[0]);
    runController(arm, seed, *record_, ends[1]);
  }
  ::close(ends[1]);
  lifeline_ = ends[0];
  Ports ports;
  const bool told = process_ > 0 && ::recv(lifeline_, &ports, sizeof ports, MSG_WAITALL) ==
                                        static_cast<ssize_t>(sizeof ports);
  if (!told) fail("it said nothing");
  address_ = {"127.0.0.1", arm.ur->serial, ports.rtde, ports.dashboard, ports.program};
}

ControllerProcess::~ControllerProcess() {
  ::close(lifeline_);
  ::waitpid(process_, nullptr, 0);
  ::munmap(record_, sizeof(MotionRecord));
}

}  // namespace servocal::sim
