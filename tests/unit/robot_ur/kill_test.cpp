// SPDX-License-Identifier: GPL-3.0-or-later
// The program or the cable dies while the arm moves. What stops the arm then is the program on the
// controller, so every check here is also run with a part of that program taken out, and must fail.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <vector>

#include "rtde_client.h"
#include "script.h"
#include "ur_cell.h"

namespace servocal::robot::ur {
namespace {

using namespace test;

constexpr double kWatchdogS = 0.2;
constexpr double kRampS = 0.1;  // Braking from 50 mm/s, and a few steps of the controller.

ArmOptions watched() {
  ArmOptions options = patient();
  options.watchdog = fromSeconds(kWatchdogS);
  return options;
}

std::string without(std::string text, const std::string& part, const std::string& instead) {
  const std::size_t at = text.find(part);
  EXPECT_NE(at, std::string::npos) << "the program has no '" << part << "'";
  return text.replace(at, part.size(), instead);
}
std::string withoutWatchdog(const std::string& text) { return without(text, "  rtde_set_watchdog", "  # "); }
std::string withoutHeartbeatTest(const std::string& text) {
  return without(text, "if age > ", "if 0 > 1 + ");
}

using Edit = std::function<std::string(std::string)>;

UrControllerOptions edited(const Edit& edit) {
  UrControllerOptions options;
  options.edit_program = edit;
  return options;
}

/// What the controller did after the last input that asked for a motion.
struct Aftermath {
  bool stood = false;        ///< Within ten times the watchdog's time.
  double moved_for_s = 0.0;  ///< By the controller's clock.
  bool program_ended = false;
};

Aftermath aftermath(UrCell& cell) {
  Aftermath result;
  result.stood = cell.waitFor([&] { return cell.stands(); }, 10 * kWatchdogS);
  result.program_ended = cell.waitFor([&] { return !cell.controller.truth().program_runs; }, 10 * kWatchdogS);
  const UrControllerTruth truth = cell.controller.truth();
  result.moved_for_s = truth.last_motion_s - truth.last_moving_input_s;
  return result;
}

/// The cable is cut one way: the controller hears nothing any more, and we do not notice.
Aftermath afterSilence(const Edit& edit) {
  UrCell cell(edited(edit));
  const auto arm = cell.armed(watched());
  EXPECT_FALSE(cell.drive(*arm, UrCell::up(), [&] { return cell.moves(); }));
  EXPECT_TRUE(cell.moves());
  cell.controller.misbehave(UrFault::kDeaf);
  return aftermath(cell);
}

TEST(UrKill, SilenceStopsTheArmAndEndsTheProgram) {
  const Aftermath after = afterSilence(nullptr);
  EXPECT_TRUE(after.stood);
  EXPECT_LT(after.moved_for_s, kWatchdogS + kRampS);
  EXPECT_TRUE(after.program_ended);
}

TEST(UrKill, SilenceWithoutTheWatchdogLineIsNoticedByThisTest) {
  EXPECT_FALSE(afterSilence(withoutWatchdog).program_ended);
}

TEST(UrKill, SilenceWithNeitherMovesOn) {
  const Aftermath after =
      afterSilence([](std::string text) { return withoutHeartbeatTest(withoutWatchdog(text)); });
  EXPECT_FALSE(after.stood);
}

/// A sender that goes on sending but has stopped thinking: packages with the same heartbeat.
Aftermath afterStuckSender(const Edit& edit) {
  UrCell cell;
  RtdeClient client("127.0.0.1", cell.controller.rtdePort(), std::chrono::seconds(5));
  client.start(0.0);
  ScriptOptions options;
  options.limits = cell.limits;
  options.watchdog = fromSeconds(kWatchdogS);
  options.token = 1;
  const std::string text = servoScript(options);
  Socket primary("127.0.0.1", cell.controller.programPort(), "program port", std::chrono::seconds(5));
  primary.send(ByteWriter().text(edit ? edit(text) : text).bytes(), std::chrono::seconds(5));

  ScriptInput input;
  const auto sendUntil = [&](const std::function<bool()>& condition, int beats, double seconds) {
    return cell.waitFor(
        [&] {
          input.heartbeat += beats;
          client.send(input);
          client.receive();
          cell.clock.sleepFor(std::chrono::milliseconds(7));
          return condition();
        },
        seconds);
  };
  EXPECT_TRUE(sendUntil([&] { return cell.controller.truth().program_runs; }, 1, 10.0));
  sendUntil([] { return false; }, 1, 0.2);  // The epoch it finds at its start is an old one.
  input.epoch = 9;
  sendUntil([] { return false; }, 1, 0.1);
  input.mode = ScriptMode::kTwist;
  input.velocity << 0.0, 0.0, 0.05, 0.0, 0.0, 0.0;
  EXPECT_TRUE(sendUntil([&] { return cell.moves(); }, 1, 10.0));
  const double stuck_since_s = cell.controller.truth().time_s;
  Aftermath result;
  result.stood = sendUntil([&] { return cell.stands(); }, 0, 5 * kWatchdogS);
  result.moved_for_s = cell.controller.truth().last_motion_s - stuck_since_s;
  return result;
}

TEST(UrKill, StuckSenderStopsTheArm) {
  const Aftermath after = afterStuckSender(nullptr);
  EXPECT_TRUE(after.stood);
  EXPECT_LT(after.moved_for_s, kWatchdogS + kRampS);
}

TEST(UrKill, StuckSenderWithoutTheHeartbeatTestMovesOn) {
  EXPECT_FALSE(afterStuckSender(withoutHeartbeatTest).stood);
}

/// A program of its own that moves the arm until somebody ends it.
class Driver {
 public:
  explicit Driver(const UrCell& cell) {
    int ends[2];
    EXPECT_EQ(::pipe2(ends, O_CLOEXEC), 0);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    std::vector<std::string> words = {SERVOCAL_UR_DRIVER, std::to_string(cell.controller.rtdePort()),
                                      std::to_string(cell.controller.dashboardPort()),
                                      std::to_string(cell.controller.programPort()),
                                      std::to_string(kWatchdogS)};
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    EXPECT_EQ(::posix_spawn(&process_, SERVOCAL_UR_DRIVER, &actions, nullptr, arguments.data(), environ), 0);
    posix_spawn_file_actions_destroy(&actions);
    ::close(ends[1]);
    output_ = ends[0];
  }
  ~Driver() {
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
    ::close(output_);
  }
  void signal(int number) const { ::kill(process_, number); }

 private:
  pid_t process_ = -1;
  int output_ = -1;
};

Aftermath afterSignal(int number, const Edit& edit = nullptr) {
  UrCell cell(edited(edit));
  const Driver driver(cell);
  EXPECT_TRUE(cell.waitFor([&] { return cell.moves(); }, 30.0));
  driver.signal(number);
  Aftermath result = aftermath(cell);
  if (number == SIGSTOP) {  // It wakes up again and does not know that anything happened.
    const auto before = cell.controller.truth().q;
    driver.signal(SIGCONT);
    cell.clock.sleepFor(std::chrono::milliseconds(500));
    EXPECT_LT((cell.controller.truth().q - before).cwiseAbs().maxCoeff(), 1e-9);
  }
  return result;
}

TEST(UrKill, KilledProgramStopsTheArm) {
  const Aftermath after = afterSignal(SIGKILL);
  EXPECT_TRUE(after.stood);
  EXPECT_LT(after.moved_for_s, kWatchdogS + kRampS);
  EXPECT_TRUE(after.program_ended);
}

TEST(UrKill, FrozenProgramStopsTheArmAndDoesNotGoOnWhenItWakes) {
  const Aftermath after = afterSignal(SIGSTOP);
  EXPECT_TRUE(after.stood);
  EXPECT_LT(after.moved_for_s, kWatchdogS + kRampS);
  EXPECT_TRUE(after.program_ended);
}

TEST(UrKill, KilledProgramWithNeitherLineMovesOn) {
  const Edit neither = [](std::string text) { return withoutHeartbeatTest(withoutWatchdog(text)); };
  EXPECT_FALSE(afterSignal(SIGKILL, neither).stood);
}

}  // namespace
}  // namespace servocal::robot::ur
