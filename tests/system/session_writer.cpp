// SPDX-License-Identifier: GPL-3.0-or-later
// session_writer FOLDER: writes a session as a run does, only without pause, until it is killed. Continues
// one that is there. Writes to standard output 0 when it begins, then the id of every observation once it is
// promised to be stored, as 8-byte integers.
#include <unistd.h>

#include <iostream>

#include "servocal/core/error.h"
#include "servocal/session/session.h"
#include "session_scene.h"

int main(int, char** argv) {
  using namespace servocal;
  const std::filesystem::path folder = argv[1];
  const std::int64_t begins = 0;
  if (write(STDOUT_FILENO, &begins, sizeof begins) != sizeof begins) return 1;
  try {
    session::Session session = [&] {
      try {
        return session::Session::openForAppend(folder);
      } catch (const Error&) {  // There is none, or its program died while making it.
        return session::Session::create(folder, "name: killed", BoardSpec{}, 1);
      }
    }();
    for (;;) {
      const std::int64_t next = static_cast<std::int64_t>(session.observations().size()) + 1;
      std::mt19937_64 random(static_cast<std::uint64_t>(next));
      const Observation stored = session.add(test::randomObservation(random, true),
                                             {test::noiseImage(next), {test::noiseImage(-next), {}}});
      if (write(STDOUT_FILENO, &stored.id, sizeof stored.id) != sizeof stored.id) return 1;
      Attempt attempt;
      attempt.observation_id = stored.id;
      session.add(attempt);
      session.event(Instant(Duration(next)), "stage", "view " + std::to_string(next));
    }
  } catch (const std::exception& error) {
    std::cerr << "session_writer: " << error.what() << '\n';
    return 1;
  }
}
