// SPDX-License-Identifier: GPL-3.0-or-later
// Disks that are full, read-only or gone; sessions that are continued, also by the next version's program.
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <unistd.h>

#include <fstream>

#include "database.h"
#include "errors.h"
#include "servocal/session/check.h"
#include "servocal/session/session.h"
#include "session_scene.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;
using test::expectPart;
using test::expectSame;
using test::messageOf;
using test::noiseImage;
using test::randomObservation;
using test::statusOfChild;
using test::TemporaryFolder;

constexpr int kNoMount = 77;

/// Mounts a small file system over `folder`, seen by this process alone. False if the system forbids it.
bool mountSmallDisk(const fs::path& folder) {
  const int flags = geteuid() == 0 ? CLONE_NEWNS : CLONE_NEWNS | CLONE_NEWUSER;
  return unshare(flags) == 0 && mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0 &&
         mount("none", folder.c_str(), "tmpfs", 0, "size=1m") == 0;
}

/// Adds observations with images until the disk refuses; returns the sentence. The stored ones go to
/// `stored`.
std::string fillUp(Session& session, std::vector<Observation>& stored) {
  std::mt19937_64 random(1);
  for (;;) {
    const Observation observation = randomObservation(random, true);
    try {
      stored.push_back(
          session.add(observation, {noiseImage(stored.size()), noiseImage(1000 + stored.size())}));
    } catch (const Error& error) {
      return error.what();
    }
  }
}

/// As seen by somebody else.
void expectStored(const fs::path& folder, const std::vector<Observation>& stored) {
  const std::vector<Observation> read = Session::open(folder).observations();
  ASSERT_EQ(read.size(), stored.size());
  for (std::size_t i = 0; i < stored.size(); ++i) expectSame(read[i], stored[i]);
  EXPECT_TRUE(checkSession(folder).whole());
}

void endChildByVerdict() {
  if (testing::Test::HasFailure()) _exit(1);
}

TEST(Durability, AFullDiskLosesNothingAndSaysSo) {
  const TemporaryFolder folder;
  const int status = statusOfChild([&] {
    if (!mountSmallDisk(folder.path())) _exit(kNoMount);
    Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
    folder.write("filler", std::string(200000, 'x'));
    std::vector<Observation> stored;
    const std::string sentence = fillUp(session, stored);
    expectPart(sentence, "what was stored before is safe, free some space and start again");
    EXPECT_GT(stored.size(), 10u);
    expectStored(folder / "run", stored);
    fs::remove(folder / "filler");
    const std::size_t before = stored.size();
    std::vector<Observation> more;
    std::mt19937_64 random(2);
    stored.push_back(session.add(randomObservation(random, true), {noiseImage(1), noiseImage(2)}));
    EXPECT_EQ(stored.back().id, static_cast<std::int64_t>(before) + 1);
    expectStored(folder / "run", stored);
    endChildByVerdict();
  });
  if (WEXITSTATUS(status) == kNoMount) GTEST_SKIP() << "the system forbids to mount a small disk";
  EXPECT_EQ(WEXITSTATUS(status), 42);
}

// The database alone meets the end of the disk, in the middle of its log.
TEST(Durability, AFileThatMayNotGrowLosesNothing) {
  const TemporaryFolder folder;
  const int status = statusOfChild([&] {
    Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit = {800000, 800000};
    if (setrlimit(RLIMIT_FSIZE, &limit) != 0) _exit(kNoMount);
    std::vector<Observation> stored;
    EXPECT_FALSE(fillUp(session, stored).empty());
    EXPECT_GT(stored.size(), 10u);
    expectStored(folder / "run", stored);
    endChildByVerdict();
  });
  EXPECT_EQ(WEXITSTATUS(status), 42);
}

TEST(Durability, ADiskThatBecomesReadOnlyLosesNothing) {
  const TemporaryFolder folder;
  const int status = statusOfChild([&] {
    if (!mountSmallDisk(folder.path())) _exit(kNoMount);
    std::mt19937_64 random(3);
    std::vector<Observation> stored;
    {
      Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
      stored.push_back(session.add(randomObservation(random, true), {noiseImage(1), noiseImage(2)}));
    }
    if (mount("none", folder.path().c_str(), nullptr, MS_REMOUNT | MS_RDONLY, nullptr) != 0) _exit(kNoMount);
    expectPart(messageOf(ErrorKind::kBadData, [&] { Session::openForAppend(folder / "run"); }),
               "Read-only file system");
    expectPart(messageOf(ErrorKind::kBadData, [&] { Session::create(folder / "new", "", BoardSpec{}, 1); }),
               "Read-only file system");
    expectStored(folder / "run", stored);
    endChildByVerdict();
  });
  if (WEXITSTATUS(status) == kNoMount) GTEST_SKIP() << "the system forbids to mount a small disk";
  EXPECT_EQ(WEXITSTATUS(status), 42);
}

// SQLite would write on into a file that has no name anymore.
TEST(Durability, ARemovedFolderIsNoticed) {
  for (const bool with_images : {false, true}) {
    const TemporaryFolder folder;
    std::mt19937_64 random(4);
    Session session = Session::create(folder / "run", "", BoardSpec{}, 1);
    session.add(randomObservation(random, true), {});
    fs::remove_all(folder / "run");
    const std::vector<ViewImages> images =
        with_images ? std::vector<ViewImages>{noiseImage(1), noiseImage(2)} : std::vector<ViewImages>();
    expectPart(
        messageOf(ErrorKind::kBadData, [&] { session.add(randomObservation(random, true), images); }),
        with_images ? "No such file or directory" : "was removed or replaced while it was being written");
    expectPart(messageOf(ErrorKind::kBadData, [&] { session.event({}, "stage", "x"); }),
               "was removed or replaced");
  }
}

TEST(Durability, ASessionIsContinuedWhereItEnded) {
  const TemporaryFolder folder;
  std::mt19937_64 random(5);
  std::vector<Observation> stored;
  expectPart(messageOf(ErrorKind::kBadData, [&] { Session::openForAppend(folder / "run"); }),
             "holds no session");
  EXPECT_FALSE(fs::exists(folder / "run"));
  {
    Session session = Session::create(folder / "run", "name: x", BoardSpec{}, 7);
    for (int i = 0; i < 3; ++i) stored.push_back(session.add(randomObservation(random, true), {}));
    session.event(Instant(Duration(5)), "stage", "first");
    expectPart(messageOf(ErrorKind::kBadData, [&] { Session::openForAppend(folder / "run"); }),
               "is being written by another program");
  }
  // As a program leaves it that died before it committed observation 4.
  folder.write("run/images/000004_cam1_color.png", "of nobody");
  Session session = Session::openForAppend(folder / "run");
  stored.push_back(session.add(randomObservation(random, true), {noiseImage(1), noiseImage(2)}));
  session.event(Instant(Duration(6)), "stage", "second");
  EXPECT_EQ(stored.back().id, 4);
  EXPECT_EQ(session.seed(), 7u);
  EXPECT_EQ(session.events().at(1).message, "second");
  expectPart(session.programs(), "SQLite 3");
  expectStored(folder / "run", stored);
}

TEST(Durability, AnOlderSessionIsBroughtUpToDateWhenContinued) {
  for (const int version : {2, 3}) {
    const TemporaryFolder folder;
    std::mt19937_64 random(6);
    std::vector<Observation> stored;
    Observation old = randomObservation(random, true);
    if (version == 2) old.views[1].depth.reset();
    {
      stored.push_back(
          Session::create(folder / "run", "", BoardSpec{}, 1).add(old, {noiseImage(1), noiseImage(2)}));
    }
    {
      const Database database(folder / "run" / "session.sqlite", Database::Access::kWrite);
      database.execute("ALTER TABLE view DROP COLUMN image_sha256");
      database.execute(version == 2 ? "DROP TABLE depth_patch; DROP TABLE corner_depth; DROP TABLE depth; "
                                      "UPDATE meta SET value = 2 WHERE key = 'schema_version'"
                                    : "ALTER TABLE depth DROP COLUMN image_sha256; "
                                      "UPDATE meta SET value = 3 WHERE key = 'schema_version'");
    }
    expectStored(folder / "run", stored);
    EXPECT_EQ(checkSession(folder / "run").notes.size(), 2u);  // no hashes; the version
    {
      Session session = Session::openForAppend(folder / "run");
      stored.push_back(session.add(randomObservation(random, true), {noiseImage(3), noiseImage(4)}));
    }
    expectStored(folder / "run", stored);
    EXPECT_EQ(checkSession(folder / "run").images, 4);
  }
}

}  // namespace
}  // namespace servocal::session
