// SPDX-License-Identifier: GPL-3.0-or-later
// What a person does to a running program: Ctrl-C, once and twice, a closed terminal, kill; and what is left then.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <thread>

#include "cells.h"
#include "run_program.h"
#include "servocal/core/error.h"
#include "servocal/session/check.h"

namespace servocal {
namespace {

/// servocal-calibrate with its session in a folder of its own, waited for until it has observed something.
class Running {
 public:
  /// `on_terminal`: it is started on a terminal of its own, which close() closes.
  explicit Running(bool on_terminal = false) {
    child_ = on_terminal ? forkpty(&terminal_, nullptr, nullptr, nullptr) : fork();
    if (child_ == 0) {
      if (!on_terminal) {
        const int nowhere = open("/dev/null", O_WRONLY);
        dup2(nowhere, STDOUT_FILENO);
        dup2(open((folder_ / "err").c_str(), O_WRONLY | O_CREAT, 0600), STDERR_FILENO);
      }
      execl(SERVOCAL_CALIBRATE, SERVOCAL_CALIBRATE, SERVOCAL_CELLS "/one_camera.yaml", "--out", session().c_str(),
            nullptr);
      _exit(99);
    }
    while (observations() < 2) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  ~Running() {
    kill(child_, SIGKILL);
    waitpid(child_, nullptr, 0);
    if (terminal_ >= 0) ::close(terminal_);
  }
  std::filesystem::path session() const { return folder_ / "session"; }
  void send(int signal) const { kill(child_, signal); }
  void closeTerminal() {
    ::close(terminal_);
    terminal_ = -1;
  }
  int wait() const {
    int status = 0;
    waitpid(child_, &status, 0);
    return status;
  }
  std::string err() const { return test::runProgram("cat " + test::shellWord((folder_ / "err").string())).out; }

 private:
  std::size_t observations() const {
    try {
      return session::Session::open(session()).observations().size();
    } catch (const Error&) {  // Not yet.
      return 0;
    }
  }

  test::TemporaryFolder folder_;
  pid_t child_ = -1;
  int terminal_ = -1;
};

void expectSaved(const Running& running) {
  const session::SessionCheck check = session::checkSession(running.session());
  EXPECT_TRUE(check.whole());
  EXPECT_GE(check.observations, 2);
}

TEST(Operator, OneSignalStopsTheArmAndSaves) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    Running running;
    running.send(signal);
    const int status = running.wait();
    ASSERT_TRUE(WIFEXITED(status)) << strsignal(signal);
    EXPECT_EQ(WEXITSTATUS(status), 7) << strsignal(signal);
    EXPECT_NE(running.err().find("Stopped by the operator. The arm stands still"), std::string::npos) << running.err();
    expectSaved(running);
  }
}

TEST(Operator, ASecondSignalEndsTheProgramAtOnce) {
  Running running;
  running.send(SIGINT);
  running.send(SIGTERM);
  const int status = running.wait();
  EXPECT_TRUE(WIFSIGNALED(status));
  expectSaved(running);
}

TEST(Operator, AClosedTerminalStopsTheArmAndSaves) {
  Running running(/*on_terminal=*/true);
  running.closeTerminal();
  const int status = running.wait();
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 7);
  expectSaved(running);
}

TEST(Operator, ARealArmIsNotMoved) {
  const test::TemporaryFolder folder;
  std::string text = test::oneCameraCell().text;
  const std::string simulated = "  backend: sim\n  urdf";
  text.replace(text.find(simulated), simulated.size(), "  backend: ur\n  host: 127.0.0.1\n  serial: '1'\n  urdf");
  const auto file = folder.write("cell.yaml", text);
  for (const char* program : {SERVOCAL_CALIBRATE " ", SERVOCAL_CHECK " --result x.yaml "}) {
    const auto run = test::runProgram(program + test::shellWord(file.string()) + " --out " +
                                      test::shellWord((folder / "session").string()) + " < /dev/null");
    EXPECT_EQ(run.exit_code, 9) << run.err;
    EXPECT_FALSE(std::filesystem::exists(folder / "session"));
  }
}

}  // namespace
}  // namespace servocal
