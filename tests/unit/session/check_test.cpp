// SPDX-License-Identifier: GPL-3.0-or-later
// What is damaged is found and named, and the rest is saved.
#include "servocal/session/check.h"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>

#include "cells.h"
#include "database.h"
#include "errors.h"
#include "session_scene.h"
#include "sha256.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

namespace fs = std::filesystem;
using test::expectPart;
using test::expectSame;
using test::messageOf;
using test::noiseImage;
using test::randomObservation;
using test::TemporaryFolder;

std::string bytesOf(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

void setBytes(const fs::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

std::vector<Observation> makeSession(const fs::path& folder, int count) {
  std::mt19937_64 random(1);
  std::vector<Observation> stored;
  Session session = Session::create(folder, test::oneCameraCell().text, BoardSpec{}, 1);
  for (int i = 0; i < count; ++i) {
    stored.push_back(
        session.add(randomObservation(random, true), {noiseImage(2 * i), {noiseImage(2 * i + 1), {}}}));
    Attempt attempt;
    attempt.status = DriveStatus::kReached;
    attempt.observation_id = stored.back().id;
    session.add(attempt);
    session.event(Instant(Duration(i)), "stage", "view " + std::to_string(i));
  }
  return stored;
}

void change(const fs::path& folder, const char* sql) {
  Database(folder / "session.sqlite", Database::Access::kWrite).execute(sql);
}

TEST(Sha256, KnowsTheStandardsExamples) {  // FIPS 180-2, appendix B.1 and the empty message
  EXPECT_EQ(sha256("abc", 3), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("", 0), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(SessionCheck, FindsNothingInASoundSession) {
  const TemporaryFolder folder;
  makeSession(folder / "run", 3);
  const SessionCheck check = checkSession(folder / "run");
  EXPECT_TRUE(check.whole()) << check.damage.front();
  EXPECT_EQ(check.observations, 3);
  EXPECT_EQ(check.images, 6);
  EXPECT_TRUE(check.notes.empty());
  const std::string before = bytesOf(folder / "run/session.sqlite");
  EXPECT_TRUE(repairSession(folder / "run").backup.empty());
  EXPECT_EQ(bytesOf(folder / "run/session.sqlite"), before);
  expectPart(messageOf(ErrorKind::kBadData, [&] { checkSession(folder.path()); }), "holds no session");
}

TEST(SessionCheck, NamesEveryDamagedImageAndRepairKeepsItsCorners) {
  const TemporaryFolder folder;
  std::vector<Observation> stored = makeSession(folder / "run", 4);
  const auto image = [&](int i, int view) { return folder / "run" / stored[i].views[view].image_file; };
  std::string bytes = bytesOf(image(0, 0));
  bytes[bytes.size() / 2] ^= 1;  // One bit.
  setBytes(image(0, 0), bytes);
  setBytes(image(1, 1), bytesOf(image(1, 1)).substr(0, 100));
  fs::remove(image(2, 0));
  folder.write("run/images/000009_cam1_color.png.tmp", "half");
  const SessionCheck check = checkSession(folder / "run");
  ASSERT_EQ(check.damage.size(), 3u);
  expectPart(check.damage[0], "observation 1: image '" + image(0, 0).string() + "' is not what was stored");
  expectPart(check.damage[1], "observation 2");
  expectPart(check.damage[2], "is not there");
  EXPECT_EQ(check.observations, 4);
  EXPECT_EQ(check.images, 5);
  ASSERT_EQ(check.notes.size(), 1u);
  expectPart(check.notes[0], "1 files in images/ belong to no observation");

  const SessionRepair repair = repairSession(folder / "run");
  EXPECT_EQ(repair.backup, folder / "run/backup-1");
  EXPECT_EQ(repair.dropped.size(), 3u);
  EXPECT_EQ(repair.observations, 4);
  EXPECT_EQ(bytesOf(repair.backup / stored[0].views[0].image_file), bytes);
  stored[0].views[0].image_file.clear();
  stored[1].views[1].image_file.clear();
  stored[2].views[0].image_file.clear();
  const Session session = Session::open(folder / "run");
  const std::vector<Observation> read = session.observations();
  ASSERT_EQ(read.size(), 4u);
  for (int i = 0; i < 4; ++i) expectSame(read[i], stored[i]);
  EXPECT_EQ(session.attempts().size(), 4u);
  EXPECT_EQ(session.events().size(), 4u);
  EXPECT_EQ(session.cellText(), test::oneCameraCell().text);
  EXPECT_TRUE(checkSession(folder / "run").whole());
}

TEST(SessionCheck, DropsOnlyWhatCannotBeRead) {
  const TemporaryFolder folder;
  const std::vector<Observation> stored = makeSession(folder / "run", 5);
  change(folder / "run",
         "UPDATE observation SET bMe = '[[1' WHERE id = 2; "
         "UPDATE view SET stream = 'ultraviolet' WHERE observation_id = 4; "
         "UPDATE attempt SET status = 'lost in thought' WHERE id = 5");
  const SessionCheck check = checkSession(folder / "run");
  ASSERT_EQ(check.damage.size(), 3u);
  expectPart(check.damage[0], "observation 2: the session holds a damaged value");
  expectPart(check.damage[1], "observation 4: the session names an unknown 'ultraviolet'");
  expectPart(check.damage[2], "attempt 5");
  const SessionRepair repair = repairSession(folder / "run");
  EXPECT_EQ(repair.observations, 3);
  EXPECT_EQ(repair.dropped.size(), 3u);
  Session session = Session::openForAppend(folder / "run");
  const std::vector<Observation> read = session.observations();
  ASSERT_EQ(read.size(), 3u);
  for (const auto& [at, id] : {std::pair(0, 1), {1, 3}, {2, 5}}) expectSame(read[at], stored[id - 1]);
  EXPECT_EQ(session.attempts().size(), 4u);
  EXPECT_FALSE(session.attempts()[1].observation_id);  // Of the dropped one.
  std::mt19937_64 random(9);
  EXPECT_EQ(session.add(randomObservation(random, true), {}).id, 6);
}

// Pages overwritten as a failing disk does; whatever page it is, the rest is saved or the user is told.
TEST(SessionCheck, SurvivesEveryDamagedPage) {
  const TemporaryFolder folder;
  const std::vector<Observation> stored = makeSession(folder / "sound", 12);
  const std::string sound = bytesOf(folder / "sound/session.sqlite");
  const std::size_t page = 4096, pages = sound.size() / page;
  ASSERT_GT(pages, 10u);
  int found = 0, saved = 0;
  for (std::size_t i = 0; i < pages; ++i) {
    const fs::path run = folder / ("run" + std::to_string(i));
    fs::copy(folder / "sound", run, fs::copy_options::recursive);
    std::string bytes = sound;
    std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(i * page), page, '\x5a');
    setBytes(run / "session.sqlite", bytes);
    const SessionCheck check = checkSession(run);
    found += !check.whole();
    try {
      const SessionRepair repair = repairSession(run);
      EXPECT_TRUE(checkSession(run).whole() || Session::open(run).observations().empty()) << "page " << i;
      for (const Observation& read : Session::open(run).observations()) {
        expectSame(read, stored[static_cast<std::size_t>(read.id) - 1]);
      }
      saved += repair.observations;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kBadData) << error.what();
      EXPECT_TRUE(fs::exists(run / "backup-1/session.sqlite")) << error.what();
    }
  }
  EXPECT_EQ(found, static_cast<int>(pages));
  // Half of the pages of so small a session are roots: with one of them a whole table is gone.
  EXPECT_GT(saved, static_cast<int>(pages * stored.size() / 3));
}

TEST(SessionCheck, RepairWaitsForTheWriter) {
  const TemporaryFolder folder;
  makeSession(folder / "run", 1);
  const Session writer = Session::openForAppend(folder / "run");
  expectPart(messageOf(ErrorKind::kBadData, [&] { repairSession(folder / "run"); }),
             "is being written by another");
}

TEST(DescribeSession, SaysWhatIsThere) {
  const TemporaryFolder folder;
  makeSession(folder / "run", 3);
  const std::string text = describeSession(Session::open(folder / "run"));
  for (const char* part : {"cell 'one camera', seed 1", "3 observations: 3 cover", "3 cam1 color",
                           "3 attempts: 3 reached", "No result", "stage: view 2"}) {
    expectPart(text, part);
  }
}

TEST(Session, KeepsTheResolvedCell) {
  const TemporaryFolder folder;
  const CellConfig cell = test::oneCameraCell();
  { Session::create(folder / "run", cell, 1); }
  const Database database(folder / "run/session.sqlite", Database::Access::kRead);
  Statement query(database, "SELECT value FROM meta WHERE key = 'cell_resolved'");
  ASSERT_TRUE(query.step());
  expectPart(query.text(0), "\"revisit_views\": 8");  // A default.
  expectPart(query.text(0), "\"max_speed_mps\": 0.25");
}

}  // namespace
}  // namespace servocal::session
