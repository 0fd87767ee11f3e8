// SPDX-License-Identifier: GPL-3.0-or-later
// What fakenect lacks of libfreenect, as functions of the same names in the test program, which come first:
// several Kinects with serial numbers, infrared, settings, unplugging, and refusals where the real library
// refuses.
#pragma once

#include <libfreenect.h>

#include <mutex>
#include <string>
#include <vector>

namespace servocal::test {

/// The Kinects on the imagined USB; shared by the test and libfreenect's thread.
struct FakeKinects {
  std::mutex mutex;
  std::vector<std::string> serials{"A00362A01385118A"};
  bool busy = false;       ///< Another program has them.
  bool cable_cut = false;  ///< Of the one that is open.
  bool obeys_flags = true;
  std::vector<freenect_flag> off;       ///< Flags switched off since the color stream was started last.
  std::vector<std::string> violations;  ///< What the real library or device would not have stood.
};
FakeKinects& fakeKinects();

/// Counts of the ten bits of infrared in the rows that depth has not.
constexpr int kMarginCounts = 1023;

}  // namespace servocal::test
