// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/session/session.h"

#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "errors.h"
#include "database.h"
#include "session_scene.h"
#include "poses.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

using test::expectPart;
using test::expectSame;
using test::messageOf;
using test::noiseImage;
using test::oddBoard;
using test::randomObservation;
using test::statusOfChild;
using test::TemporaryFolder;

TEST(Session, ReadsBackWhatWasStoredToTheLastBit) {
  const TemporaryFolder folder;
  std::mt19937_64 random(1);
  std::vector<Observation> stored;
  Attempt attempt;
  attempt.stage = "cover";
  attempt.camera = "cam1";
  attempt.start = Instant(Duration(10));
  attempt.end = Instant(Duration(20));
  attempt.cdMo = test::randomPose<Color, Board>(random, 3.0, 1.0);
  attempt.status = DriveStatus::kTargetLost;
  attempt.reason = "Target lost: \"hidden\" by the arm's elbow; 20 \xC2\xB0 off.";
  {
    Session session = Session::create(folder / "run", "name: x\n# \xC3\xA4\n", oddBoard(), ~0ull);
    for (int i = 0; i < 3; ++i) {
      stored.push_back(session.add(randomObservation(random, i != 1), {noiseImage(i), cv::Mat()}));
      EXPECT_EQ(stored.back().id, i + 1);
    }
    attempt = session.add(attempt);
    EXPECT_EQ(attempt.id, 1);
    Attempt nowhere;
    nowhere.observation_id = 2;
    EXPECT_EQ(session.add(nowhere).id, 2);
    session.event(Instant(Duration(5)), "stage", "cover begins");
    expectSame(session.observations().at(2), stored[2]);
  }
  const Session session = Session::open(folder / "run");
  EXPECT_EQ(session.cellText(), "name: x\n# \xC3\xA4\n");
  EXPECT_EQ(session.board().spacing(), oddBoard().spacing());
  EXPECT_EQ(session.board().margin_m, oddBoard().margin_m);
  EXPECT_EQ(session.board().as<Checkerboard>()->squares_x, 7);
  const std::vector<Observation> read = session.observations();
  ASSERT_EQ(read.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    expectSame(read[i], stored[i]);
    const cv::Mat image =
        cv::imread((folder / "run" / read[i].views[0].image_file).string(), cv::IMREAD_UNCHANGED);
    EXPECT_EQ(cv::norm(image, noiseImage(i), cv::NORM_INF), 0.0);
    EXPECT_EQ(read[i].views[1].image_file, "");
  }
  EXPECT_EQ(read[2].views[0].image_file, "images/000003_cam1_color.png");
  const std::vector<Attempt> attempts = session.attempts();
  ASSERT_EQ(attempts.size(), 2u);
  EXPECT_EQ(attempts[0].cdMo.isometry().matrix(), attempt.cdMo.isometry().matrix());
  EXPECT_EQ(attempts[0].status, DriveStatus::kTargetLost);
  EXPECT_EQ(attempts[0].reason, attempt.reason);
  EXPECT_EQ(attempts[0].end, attempt.end);
  EXPECT_FALSE(attempts[0].observation_id.has_value());
  EXPECT_FALSE(attempts[1].cdMo.isFinite());
  EXPECT_EQ(attempts[1].observation_id, 2);
}

// The promise: what add() returned for is there, whatever happens to the program the moment after.
TEST(Session, ObservationIsDurableBeforeAddReturns) {
  for (int count : {1, 4}) {
    const TemporaryFolder folder;
    const int status = statusOfChild([&] {
      std::mt19937_64 random(2);
      Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
      for (int i = 0; i < count; ++i) {
        session.add(randomObservation(random, true), {noiseImage(i), noiseImage(100 + i)});
      }
      kill(getpid(), SIGKILL);
    });
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    const Session session = Session::open(folder / "run");
    const std::vector<Observation> read = session.observations();
    ASSERT_EQ(read.size(), static_cast<std::size_t>(count));
    std::mt19937_64 random(2);
    for (int i = 0; i < count; ++i) {
      Observation expected = randomObservation(random, true);
      expected.id = i + 1;
      expected.views[0].image_file = read[i].views[0].image_file;
      expected.views[1].image_file = read[i].views[1].image_file;
      expectSame(read[i], expected);
      const auto image = [&](int view) {
        return cv::imread((folder / "run" / read[i].views[view].image_file).string(), cv::IMREAD_UNCHANGED);
      };
      EXPECT_EQ(cv::norm(image(0), noiseImage(i), cv::NORM_INF), 0.0);
      EXPECT_EQ(cv::norm(image(1), noiseImage(100 + i), cv::NORM_INF), 0.0);
    }
  }
}

TEST(Session, DiesAtAnyMomentAndStillOpens) {
  // Killed from outside at moments that nobody chose; what was reported as stored must be there.
  for (int trial = 0; trial < 12; ++trial) {
    const TemporaryFolder folder;
    int reported[2];
    ASSERT_EQ(pipe(reported), 0);
    const pid_t child = fork();
    if (child == 0) {
      std::mt19937_64 random(3);
      Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
      for (;;) {
        const std::int64_t id =
            session.add(randomObservation(random, true), {noiseImage(1), noiseImage(2)}).id;
        if (write(reported[1], &id, sizeof id) != sizeof id) _exit(1);
      }
    }
    close(reported[1]);
    usleep(static_cast<useconds_t>(20000 + 7919 * trial));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    std::int64_t id = 0, last = 0;
    while (read(reported[0], &id, sizeof id) == sizeof id) last = id;
    close(reported[0]);
    if (last == 0) continue;  // Killed before anything was promised.
    const std::vector<Observation> stored = Session::open(folder / "run").observations();
    ASSERT_GE(stored.size(), static_cast<std::size_t>(last)) << "trial " << trial;
    for (const Observation& observation : stored) {
      for (const StreamObservation& view : observation.views) {
        EXPECT_FALSE(cv::imread((folder / "run" / view.image_file).string()).empty()) << view.image_file;
      }
    }
  }
}

TEST(Session, SecondInstanceIsRefused) {
  const TemporaryFolder folder;
  Session first = Session::create(folder / "run", "", BoardSpec{}, 1);
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::create(folder / "run", "", BoardSpec{}, 1); }),
             "is being written by another program");
  const int status = statusOfChild([&] {
    try {
      Session::create(folder / "run", "", BoardSpec{}, 1);
    } catch (const Error&) {
      _exit(7);
    }
  });
  EXPECT_EQ(WEXITSTATUS(status), 7);
  // Readers may look on.
  EXPECT_TRUE(Session::open(folder / "run").observations().empty());
}

TEST(Session, LockEndsWithItsHolder) {
  const TemporaryFolder folder;
  statusOfChild([&] {
    Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
    kill(getpid(), SIGKILL);
  });
  // No lock is left, but the session is.
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::create(folder / "run", "", BoardSpec{}, 1); }),
             "already holds a session");
}

TEST(Session, MissingSessionIsRefused) {
  const TemporaryFolder folder;
  EXPECT_FALSE(isSession(folder.path()));
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::open(folder.path()); }), "holds no session");
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::open(folder / "nothing"); }), "holds no session");
}

TEST(Session, DamagedSessionsAreRefused) {
  const TemporaryFolder folder;
  folder.write("text/session.sqlite", std::string(5000, 'x'));
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::open(folder / "text"); }), "not a database");
  folder.write("empty/session.sqlite", "");
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::open(folder / "empty"); }), "is empty");
  // An interrupted creation may be taken up again.
  EXPECT_NO_THROW(Session::create(folder / "empty", "", BoardSpec{}, 1));
  {
    std::mt19937_64 random(4);
    Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
    session.add(randomObservation(random, true), {});
  }
  const auto change = [&](const char* sql) {
    sqlite3* handle = nullptr;
    ASSERT_EQ(sqlite3_open((folder / "run/session.sqlite").c_str(), &handle), SQLITE_OK);
    ASSERT_EQ(sqlite3_exec(handle, sql, nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(handle);
  };
  change("UPDATE observation SET bMe = '[[1'");
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::open(folder / "run").observations(); }),
             "damaged");
  change("UPDATE meta SET value = 99 WHERE key = 'schema_version'");
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::open(folder / "run"); }), "schema version 99");
}

TEST(Session, HalfWrittenImageIsIgnored) {
  const TemporaryFolder folder;
  std::mt19937_64 random(5);
  Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
  // As a program leaves it that died while writing the first image.
  folder.write("run/images/000001_cam1_color.png.tmp", "half");
  EXPECT_TRUE(session.observations().empty());
  const Observation stored = session.add(randomObservation(random, true), {noiseImage(1), cv::Mat()});
  const cv::Mat image =
      cv::imread((folder / "run" / stored.views[0].image_file).string(), cv::IMREAD_UNCHANGED);
  EXPECT_EQ(cv::norm(image, noiseImage(1), cv::NORM_INF), 0.0);
  EXPECT_FALSE(std::filesystem::exists(folder / "run/images/000001_cam1_color.png.tmp"));
}

TEST(Session, FolderThatCannotBeWrittenIsNamed) {
  const TemporaryFolder folder;
  folder.write("file", "");
  expectPart(
      messageOf(ErrorKind::kBadData, [&] { Session::create(folder / "file/run", "", BoardSpec{}, 1); }),
      "cannot make folder '" + (folder / "file/run").string() + "': Not a directory");
}

TEST(Session, ReadOnlyFolderRefusesWritersAndServesReaders) {
  const TemporaryFolder folder;
  std::mt19937_64 random(6);
  { Session::create(folder / "run", "", BoardSpec{}, 1).add(randomObservation(random, true), {}); }
  namespace fs = std::filesystem;
  fs::permissions(folder.path(), static_cast<fs::perms>(0755));
  for (const char* name : {"run", "run/images"}) {
    fs::permissions(folder / name, static_cast<fs::perms>(0555));
  }
  const int status = statusOfChild([&] {
    // Root may write anywhere; nobody may not.
    if (geteuid() == 0 && seteuid(65534) != 0) _exit(2);
    if (Session::open(folder / "run").observations().size() != 1) _exit(3);
    try {
      Session::create(folder / "run/new", "", BoardSpec{}, 1);
    } catch (const Error& error) {
      const std::string message = error.what();
      if (error.kind() != ErrorKind::kBadData) _exit(4);
      if (message.find("Permission denied") == std::string::npos) _exit(5);
      _exit(7);
    }
  });
  for (const char* name : {"run", "run/images"}) fs::permissions(folder / name, static_cast<fs::perms>(0755));
  EXPECT_EQ(WEXITSTATUS(status), 7);
}

TEST(Session, KeepsTheDepthImageBesideTheInfraredOne) {
  const TemporaryFolder folder;
  std::mt19937_64 random(8);
  cv::Mat raw(48, 64, CV_16UC1);
  cv::randu(raw, 0, 5000);
  Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
  const Observation stored = session.add(randomObservation(random, true), {noiseImage(1), {noiseImage(2), raw}});
  ASSERT_TRUE(stored.views[1].depth);
  EXPECT_EQ(stored.views[1].depth->image_file, "images/000001_left-odd-name_depth.png");
  const cv::Mat read = cv::imread((folder / "run" / stored.views[1].depth->image_file).string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(read.type(), CV_16UC1);
  EXPECT_EQ(cv::norm(read, raw, cv::NORM_INF), 0.0);
  expectSame(session.observations().at(0), stored);
}

// Sessions of before there was depth.
TEST(Session, ReadsTheSchemaBefore) {
  const TemporaryFolder folder;
  std::mt19937_64 random(9);
  Observation old = randomObservation(random, true);
  for (StreamObservation& view : old.views) view.depth.reset();
  { old = Session::create(folder / "run", "", BoardSpec{}, 1).add(old, {}); }
  {
    const Database database(folder / "run" / "session.sqlite", Database::Access::kCreate);
    database.execute("DROP TABLE depth_patch; DROP TABLE corner_depth; DROP TABLE depth; "
                     "ALTER TABLE view DROP COLUMN image_sha256; "
                     "UPDATE meta SET value = 2 WHERE key = 'schema_version'");
  }
  expectSame(Session::open(folder / "run").observations().at(0), old);
}

TEST(Session, CallersMistakesAreNamed) {
  const TemporaryFolder folder;
  std::mt19937_64 random(7);
  Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
  EXPECT_THROW(session.add(randomObservation(random, true), {noiseImage(1)}), std::invalid_argument);
  Observation unset = randomObservation(random, true);
  unset.robot->bMe = {};
  EXPECT_THROW(session.add(unset, {}), std::invalid_argument);
  EXPECT_TRUE(session.observations().empty());
  Session reader = Session::open(folder / "run");
  EXPECT_THROW(reader.add(randomObservation(random, true), {}), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::session
