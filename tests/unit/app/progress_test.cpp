// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/app/progress.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <stdlib.h>
#include <unistd.h>

#include <functional>
#include <string>

namespace servocal::app {
namespace {

/// What `action` writes to stderr while that is a terminal of so many columns, or a pipe (0).
std::string written(int columns, const std::function<void()>& action) {
  int ends[2] = {-1, -1};  // read, write
  winsize size{};
  size.ws_col = static_cast<unsigned short>(columns);
  size.ws_row = 24;
  const bool made = columns > 0 ? openpty(&ends[0], &ends[1], nullptr, nullptr, &size) == 0 : pipe(ends) == 0;
  EXPECT_TRUE(made);
  const int kept = dup(STDERR_FILENO);
  dup2(ends[1], STDERR_FILENO);
  action();
  dup2(kept, STDERR_FILENO);
  close(kept);
  fcntl(ends[0], F_SETFL, O_NONBLOCK);
  std::string text;
  char buffer[4096];
  for (ssize_t count = 0; (count = read(ends[0], buffer, sizeof buffer)) > 0;) text.append(buffer, count);
  close(ends[0]);
  close(ends[1]);
  return text;
}

void threeLines() {
  Progress progress;
  progress.show("first, which is long");
  progress.show("second");
  progress.show("stays", true);
  progress.show("third");
  progress.finish();
}

class ProgressTest : public ::testing::Test {
 protected:
  void SetUp() override {
    setenv("TERM", "xterm", 1);
    unsetenv("NO_COLOR");
  }
  void TearDown() override { unsetenv("NO_COLOR"); }
};

TEST_F(ProgressTest, RewritesTheLineOnATerminal) {
  EXPECT_EQ(written(80, threeLines), "first, which is long\r\033[Ksecond\r\033[Kstays\r\nthird\r\n");
}

TEST_F(ProgressTest, CutsToTheTerminalButNotWhatStays) {
  EXPECT_EQ(written(10, threeLines), "first, wh\r\033[Ksecond\r\033[Kstays\r\nthird\r\n");
}

TEST_F(ProgressTest, NoColorMeansNoEscapeSequence) {
  setenv("NO_COLOR", "1", 1);
  EXPECT_EQ(written(80, threeLines),
            "first, which is long\r" + std::string(20, ' ') + "\rsecond\r      \rstays\r\nthird\r\n");
}

TEST_F(ProgressTest, IsQuietInAPipe) {
  EXPECT_EQ(written(0, threeLines), "first, which is long\nstays\n");  // a sign of life, then what matters
  setenv("TERM", "dumb", 1);
  EXPECT_EQ(written(80, threeLines), "first, which is long\r\nstays\r\n");
}

}  // namespace
}  // namespace servocal::app
