// SPDX-License-Identifier: GPL-3.0-or-later
// A program that writes a session until it is killed, and what must be left of it.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <random>

#include "servocal/core/error.h"
#include "servocal/session/check.h"
#include "servocal/session/session.h"
#include "session_scene.h"

namespace servocal::test {

/// Writes a session as a run does, only without pause, until it is killed. Continues one that is there. Tells
/// the id of every observation once it is promised to be stored.
[[noreturn]] inline void writeOn(const std::filesystem::path& folder, int promises) {
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
      const Observation stored =
          session.add(randomObservation(random, true), {noiseImage(next), {noiseImage(-next), {}}});
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
  bool killed = false;    ///< False: it ended by itself.
  std::int64_t last = 0;  ///< Id that it promised last to have stored; 0 if none.
};

/// Starts a writer, lets it promise `promises_heard` observations and kills it `then_us` later: what it is in
/// the middle of then does not depend on how busy the machine is.
inline Death deathOfAWriter(const std::filesystem::path& folder, int promises_heard, useconds_t then_us) {
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
inline void expectWhole(const std::filesystem::path& folder, std::int64_t promised) {
  const session::SessionCheck check = session::checkSession(folder);
  ASSERT_TRUE(check.whole()) << check.damage.front();
  const std::vector<Observation> stored = session::Session::open(folder).observations();
  ASSERT_GE(static_cast<std::int64_t>(stored.size()), promised);
  EXPECT_EQ(check.images, 2 * static_cast<int>(stored.size()));
  for (const Observation& observation : stored) {
    std::mt19937_64 random(static_cast<std::uint64_t>(observation.id));
    Observation written = randomObservation(random, true);
    written.id = observation.id;
    for (std::size_t i = 0; i < 2; ++i) written.views[i].image_file = observation.views[i].image_file;
    expectSame(observation, written);
  }
}

}  // namespace servocal::test
