// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_spread.h"

namespace servocal {
namespace {

// Synthetic corners, a Kinect v2 of two streams, 40 stops: claims hold, and the bound is reached.
void checkSpread(Mount mount) {
  test::SpreadCase usual;
  usual.mount = mount;
  const test::Spread spread = test::spreadOf(usual, 200);
  EXPECT_LT(spread.chi_square, test::chiSquareQuantile(spread.degrees, 2.576));
  EXPECT_GT(spread.chi_square, test::chiSquareQuantile(spread.degrees, -2.576));
  for (std::size_t g = 0; g < spread.groups.size(); ++g) {
    EXPECT_GT(spread.spread_over_claim[g], 0.85) << spread.groups[g];
    EXPECT_LT(spread.spread_over_claim[g], 1.15) << spread.groups[g];
    EXPECT_LT(spread.error_over_bound[g], 1.15) << spread.groups[g];
  }
}

TEST(SolveJointNightly, ClaimsTheSpreadItHasOver200Seeds) { checkSpread(Mount::kFixed); }
TEST(SolveJointNightly, ClaimsTheSpreadItHasOver200SeedsOnTheFlange) { checkSpread(Mount::kFlange); }

}  // namespace
}  // namespace servocal
