// SPDX-License-Identifier: GPL-3.0-or-later
// The power goes off while a program writes a session: only what was synced is sure to be there afterwards.
#include "power_loss.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <iostream>
#include <random>

#include "dying_writer.h"
#include "sync_hook.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

using Unsynced = test::SurvivingDisk::Unsynced;

constexpr int kLossesOfASession = 15;

/// A session on a disk that loses what was not synced.
struct Computer {
  test::TemporaryFolder folder;
  std::filesystem::path disk = folder / "disk", shadow = folder / "shadow";
  Computer() {
    std::filesystem::create_directory(disk);
    std::filesystem::create_directory(shadow);
  }
};

bool isFolder(int descriptor) {
  struct stat status = {};
  return fstat(descriptor, &status) == 0 && S_ISDIR(status.st_mode);
}

/// Without power three times over: nothing of what was not synced is left, or some of it, this or that.
void expectAllSurvives(const test::SurvivingDisk& disk, std::int64_t promised, std::uint64_t seed) {
  for (const Unsynced unsynced : {Unsynced::kLost, Unsynced::kPartly, Unsynced::kPartly}) {
    const test::TemporaryFolder found;
    disk.restore(found.path(), unsynced, seed++);
    test::expectWhole(found / "run", promised);
  }
}

TEST(PowerLoss, NothingThatWasPromisedIsLost) {
  std::mt19937 random(21);
  std::uniform_int_distribution<int> promises_heard(0, 3);
  std::uniform_int_distribution<useconds_t> then_us(0, 30000);
  std::int64_t promises = 0;
  for (int losses = 0; losses < SERVOCAL_POWER_LOSSES;) {
    auto computer = std::make_unique<Computer>();
    std::int64_t promised = 0;
    for (int loss = 0; loss < kLossesOfASession && losses < SERVOCAL_POWER_LOSSES; ++loss, ++losses) {
      const test::SurvivingDisk disk(computer->disk, computer->shadow);
      test::Death death;
      {
        const test::SyncHook hook([&disk](int descriptor) { disk.sync(descriptor); });
        death = test::deathOfAWriter(computer->disk / "run", promises_heard(random), then_us(random));
      }
      ASSERT_TRUE(death.killed) << "the writer ended by itself, in loss " << losses;
      promises += std::max<std::int64_t>(0, death.last - promised);
      promised = std::max(promised, death.last);
      if (promised > 0) expectAllSurvives(disk, promised, 3 * static_cast<std::uint64_t>(losses));
      ASSERT_FALSE(HasFailure()) << "loss " << losses;
      // The next program begins with what is left now.
      auto next = std::make_unique<Computer>();
      disk.restore(next->disk, loss % 2 == 0 ? Unsynced::kLost : Unsynced::kPartly,
                   static_cast<std::uint64_t>(losses));
      computer = std::move(next);
    }
  }
  std::cout << SERVOCAL_POWER_LOSSES << " losses of power, " << promises
            << " observations promised, all there.\n";
  EXPECT_GE(promises, SERVOCAL_POWER_LOSSES / 2);
}

// Negative control: a session that forgot to sync its folders, or its files, would lose what it promised.
TEST(PowerLoss, WithoutASyncWhatWasPromisedIsLost) {
  for (const bool folders : {true, false}) {
    const Computer computer;
    const test::SurvivingDisk disk(computer.disk, computer.shadow);
    const test::SyncHook hook([&](int descriptor) {
      if (isFolder(descriptor) != folders) disk.sync(descriptor);
    });
    const test::Death death = test::deathOfAWriter(computer.disk / "run", 3, 0);
    ASSERT_GE(death.last, 3);
    const test::TemporaryFolder found;
    disk.restore(found.path(), Unsynced::kLost, 1);
    const auto survived = [&] {
      try {
        const session::SessionCheck check = session::checkSession(found / "run");
        return check.whole() && check.observations >= death.last;
      } catch (const Error&) {  // There is not even a session.
        return false;
      }
    };
    EXPECT_FALSE(survived()) << (folders ? "folders" : "files");
  }
}

}  // namespace
}  // namespace servocal
