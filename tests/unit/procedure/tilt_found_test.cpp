// SPDX-License-Identifier: GPL-3.0-or-later
#include "tilt_found.h"

#include <gtest/gtest.h>

namespace servocal::procedure {
namespace {

TEST(TiltFound, IsBetweenWhatIsSeenAndWhatIsLost) {
  TiltFound found;
  found.note(15, true);
  found.note(45, false);
  found.note(30, true);
  EXPECT_EQ(found.seen_deg, 30);
  EXPECT_EQ(found.lost_deg, 45);
}

TEST(TiltFound, APictureMissedOnTheWayIsNoLimit) {
  TiltFound found;
  found.note(15, false);
  EXPECT_EQ(found.lost_deg, 15);
  found.note(30, true);
  found.note(45, true);
  found.note(20, false);
  EXPECT_EQ(found.seen_deg, 45);
  EXPECT_FALSE(found.lost_deg);
}

}  // namespace
}  // namespace servocal::procedure
