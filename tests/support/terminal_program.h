// SPDX-License-Identifier: GPL-3.0-or-later
// A program on a terminal of its own, with a person before it.
#pragma once

#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <string>

namespace servocal::test {

class TerminalProgram {
 public:
  /// Runs a shell command on it; `typed_ahead` is typed before the program begins.
  explicit TerminalProgram(const std::string& command, const std::string& typed_ahead = "") {
    child_ = ::forkpty(&terminal_, nullptr, nullptr, nullptr);
    if (child_ == 0) {
      if (!typed_ahead.empty()) ::usleep(300000);
      const std::string line = "exec " + command;  // So that a signal to the child is one to the program.
      ::execl("/bin/sh", "sh", "-c", line.c_str(), nullptr);
      ::_exit(99);
    }
    type(typed_ahead);
  }
  ~TerminalProgram() {
    if (child_ > 0) {
      ::kill(child_, SIGKILL);
      ::waitpid(child_, nullptr, 0);
    }
    ::close(terminal_);
  }

  void type(const std::string& text) const {
    [[maybe_unused]] const ssize_t written = ::write(terminal_, text.data(), text.size());
  }
  void send(int signal) const { ::kill(child_, signal); }
  /// True once the screen shows `text`; false if it does not within the time, or the terminal is closed.
  bool waitFor(const std::string& text, double seconds) {
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (screen_.find(text) == std::string::npos) {
      if (std::chrono::steady_clock::now() > give_up || !read())
        return screen_.find(text) != std::string::npos;
    }
    return true;
  }
  /// Until nobody has the terminal open any more, at most so long; the program's exit code, -1 after a
  /// signal.
  int end(double seconds) {
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (read()) {
      if (std::chrono::steady_clock::now() > give_up) {
        ::kill(child_, SIGKILL);
        break;
      }
    }
    int status = 0;
    ::waitpid(child_, &status, 0);
    child_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  const std::string& screen() const { return screen_; }

 private:
  /// What comes within 100 ms; false once the terminal is closed at the other end.
  bool read() {
    pollfd waited{terminal_, POLLIN, 0};
    if (::poll(&waited, 1, 100) <= 0) return true;
    char bytes[4096];
    const ssize_t count = ::read(terminal_, bytes, sizeof bytes);
    if (count <= 0) return false;
    screen_.append(bytes, static_cast<std::size_t>(count));
    return true;
  }

  pid_t child_ = -1;
  int terminal_ = -1;
  std::string screen_;
};

}  // namespace servocal::test
