// SPDX-License-Identifier: GPL-3.0-or-later
// Programs that write a session are killed at moments that nobody chose.
#include <gtest/gtest.h>

#include <iostream>
#include <random>

#include "dying_writer.h"
#include "temporary_folder.h"

namespace servocal {
namespace {

constexpr int kDeathsOfASession = 15;

TEST(Kill, NothingThatWasPromisedIsLost) {
  std::mt19937 random(20);
  std::uniform_int_distribution<int> promises_heard(0, 2);
  std::uniform_int_distribution<useconds_t> then_us(0, 60000);  // A stored observation takes some 30 ms.
  std::int64_t promises = 0;
  for (int kills = 0; kills < SERVOCAL_KILLS;) {
    const test::TemporaryFolder folder;
    std::int64_t promised = 0;
    for (int death = 0; death < kDeathsOfASession && kills < SERVOCAL_KILLS; ++death, ++kills) {
      const auto [killed, last] =
          test::deathOfAWriter(folder / "run", promises_heard(random), then_us(random));
      ASSERT_TRUE(killed) << "the writer ended by itself, in kill " << kills;
      promises += last > promised ? last - promised : 0;
      promised = std::max(promised, last);
      if ((kills + 1) % 100 == 0) {
        std::cout << kills + 1 << " kills, " << promises << " observations promised" << std::endl;
      }
      if (promised == 0) continue;  // It may have died before there was a session.
      test::expectWhole(folder / "run", promised);
      ASSERT_FALSE(HasFailure()) << "kill " << kills;
    }
  }
  std::cout << SERVOCAL_KILLS << " kills, " << promises << " observations promised, all there.\n";
  EXPECT_GE(promises, SERVOCAL_KILLS / 2);  // That there was something to lose.
}

}  // namespace
}  // namespace servocal
