// SPDX-License-Identifier: GPL-3.0-or-later
// Programs that write a session are killed at moments that nobody chose.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <random>

#include "servocal/session/check.h"
#include "session_scene.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

constexpr int kDeathsOfASession = 15;

/// Starts the writer, kills it `lifetime_us` after it began, and returns the last id that it promised to have
/// stored; 0 if none.
std::int64_t promisedBeforeDeath(const std::filesystem::path& folder, useconds_t lifetime_us, bool& killed) {
  int promises[2];
  if (pipe(promises) != 0) throw std::runtime_error("no pipe");
  const pid_t writer = fork();
  if (writer == 0) {
    dup2(promises[1], STDOUT_FILENO);
    close(promises[0]);
    close(promises[1]);
    execl(SERVOCAL_SESSION_WRITER, SERVOCAL_SESSION_WRITER, folder.c_str(), nullptr);
    _exit(3);
  }
  close(promises[1]);
  std::int64_t id = -1, last = 0;
  if (read(promises[0], &id, sizeof id) == sizeof id) usleep(lifetime_us);
  kill(writer, SIGKILL);
  int status = 0;
  waitpid(writer, &status, 0);
  killed = WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
  while (read(promises[0], &id, sizeof id) == sizeof id) last = id;
  close(promises[0]);
  return last;
}

/// What is stored is what was written, to the last bit, images included.
void expectWhole(const std::filesystem::path& folder, std::int64_t promised) {
  const session::SessionCheck check = session::checkSession(folder);
  ASSERT_TRUE(check.whole()) << check.damage.front();
  const std::vector<Observation> stored = session::Session::open(folder).observations();
  ASSERT_GE(static_cast<std::int64_t>(stored.size()), promised);
  EXPECT_EQ(check.images, 2 * static_cast<int>(stored.size()));
  for (const Observation& observation : stored) {
    std::mt19937_64 random(static_cast<std::uint64_t>(observation.id));
    Observation written = test::randomObservation(random, true);
    written.id = observation.id;
    for (std::size_t i = 0; i < 2; ++i) written.views[i].image_file = observation.views[i].image_file;
    test::expectSame(observation, written);
  }
}

TEST(Kill, NothingThatWasPromisedIsLost) {
  std::mt19937 random(20);
  std::uniform_int_distribution<useconds_t> lifetime_us(0, 400000);
  int before_any_promise = 0;
  std::int64_t promises = 0;
  for (int kills = 0; kills < SERVOCAL_KILLS;) {
    const test::TemporaryFolder folder;
    std::int64_t promised = 0;
    for (int death = 0; death < kDeathsOfASession && kills < SERVOCAL_KILLS; ++death, ++kills) {
      bool killed = false;
      const std::int64_t last = promisedBeforeDeath(folder / "run", lifetime_us(random), killed);
      ASSERT_TRUE(killed) << "the writer ended by itself, in kill " << kills;
      promises += last > promised ? last - promised : 0;
      promised = std::max(promised, last);
      before_any_promise += promised == 0;
      if (promised == 0) continue;  // It may have died before there was a session.
      expectWhole(folder / "run", promised);
      ASSERT_FALSE(HasFailure()) << "kill " << kills;
    }
  }
  std::cout << SERVOCAL_KILLS << " kills, " << promises << " observations promised, all there; "
            << before_any_promise << " deaths before the first.\n";
  EXPECT_LT(before_any_promise, SERVOCAL_KILLS / 2);
  EXPECT_GT(promises, SERVOCAL_KILLS);
}

}  // namespace
}  // namespace servocal
