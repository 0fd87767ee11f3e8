// SPDX-License-Identifier: GPL-3.0-or-later
#include "claimed_spread.h"

namespace servocal {
namespace {

TEST(SolveIntrinsicsNightly, ClaimsTheSpreadItHasOver200Seeds) { test::checkClaimedSpread(200); }

}  // namespace
}  // namespace servocal
