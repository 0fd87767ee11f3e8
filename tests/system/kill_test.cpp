// SPDX-License-Identifier: GPL-3.0-or-later
// Programs that write a session are killed at moments that nobody chose.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <random>

#include "servocal/core/error.h"
#include "servocal/session/check.h"
#include "session_scene.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

constexpr int kDeathsOfASession = 15;

/// Writes a session as a run does, only without pause, until it is killed. Continues one that is there. Tells the id
/// of every observation once it is promised to be stored.
[[noreturn]] void writeOn(const std::filesystem::path& folder, int promises) {
  try {
    session::Session session = [&] {
      try {
        return session::Session::openForAppend(folder);
      } catch (const Error&) {  // There is none, or its program died while making it.
        return session::Session::create(folder, "name: killed", BoardSpec{}, 1);
      }
    }();
    std::int64_t next = static_cast<std::int64_t>(session.observations().size()) + 1;
    for (;; ++next) {
      std::mt19937_64 random(static_cast<std::uint64_t>(next));
      const Observation stored = session.add(test::randomObservation(random, true),
                                             {test::noiseImage(next), {test::noiseImage(-next), {}}});
      if (write(promises, &stored.id, sizeof stored.id) != sizeof stored.id) _exit(1);
      Attempt attempt;
      attempt.observation_id = stored.id;
      session.add(attempt);
      session.event(Instant(Duration(next)), "stage", "view " + std::to_string(next));
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "writer: %s\n", error.what());
    _exit(1);
  }
}

struct Death {
  bool killed = false;     ///< False: it ended by itself.
  std::int64_t last = 0;   ///< Id that it promised last to have stored; 0 if none.
};

/// Starts a writer, lets it promise `promises_heard` observations and kills it `then_us` later: what it is in the middle
/// of then does not depend on how busy the machine is.
Death deathOfAWriter(const std::filesystem::path& folder, int promises_heard, useconds_t then_us) {
  int promises[2];
  if (pipe(promises) != 0) throw std::runtime_error("no pipe");
  const pid_t writer = fork();
  if (writer == 0) writeOn(folder, promises[1]);
  close(promises[1]);
  Death death;
  std::int64_t id = 0;
  while (promises_heard > 0 && read(promises[0], &id, sizeof id) == sizeof id) {
    death.last = id;
    --promises_heard;
  }
  usleep(then_us);
  kill(writer, SIGKILL);
  int status = 0;
  waitpid(writer, &status, 0);
  death.killed = WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
  while (read(promises[0], &id, sizeof id) == sizeof id) death.last = id;
  close(promises[0]);
  return death;
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
  std::uniform_int_distribution<int> promises_heard(0, 2);
  std::uniform_int_distribution<useconds_t> then_us(0, 60000);  // A stored observation takes some 30 ms.
  std::int64_t promises = 0;
  for (int kills = 0; kills < SERVOCAL_KILLS;) {
    const test::TemporaryFolder folder;
    std::int64_t promised = 0;
    for (int death = 0; death < kDeathsOfASession && kills < SERVOCAL_KILLS; ++death, ++kills) {
      const auto [killed, last] = deathOfAWriter(folder / "run", promises_heard(random), then_us(random));
      ASSERT_TRUE(killed) << "the writer ended by itself, in kill " << kills;
      promises += last > promised ? last - promised : 0;
      promised = std::max(promised, last);
      if ((kills + 1) % 100 == 0) {
        std::cout << kills + 1 << " kills, " << promises << " observations promised" << std::endl;
      }
      if (promised == 0) continue;  // It may have died before there was a session.
      expectWhole(folder / "run", promised);
      ASSERT_FALSE(HasFailure()) << "kill " << kills;
    }
  }
  std::cout << SERVOCAL_KILLS << " kills, " << promises << " observations promised, all there.\n";
  EXPECT_GE(promises, SERVOCAL_KILLS / 2);  // That there was something to lose.
}

}  // namespace
}  // namespace servocal
