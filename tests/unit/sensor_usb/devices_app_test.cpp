// SPDX-License-Identifier: GPL-3.0-or-later
// servocal-devices as a person runs it, on a mocked USB.
#include <gtest/gtest.h>

#include "errors.h"
#include "mock_usb.h"
#include "run_program.h"

namespace servocal {
namespace {

test::ProgramRun devices(const std::string& mocked, const std::string& arguments = "") {
  const test::TemporaryFolder folder;
  const auto file = folder.write("usb.umockdev", test::mockBus(1, 480) + test::mockBus(2, 5000) + mocked);
  return test::runProgram(std::string(SERVOCAL_UMOCKDEV_RUN) + " -d " + test::shellWord(file.string()) +
                          " -- " + SERVOCAL_DEVICES + " " + arguments);
}

TEST(DevicesApp, ListsWhatWorks) {
  const auto run = devices(test::mockText({2, 3, "2-1", 0x045e, 0x02c4, 5000, "012345643247", 0xff}) +
                           test::mockText({1, 4, "1-3", 0x1d27, 0x0601, 480, "", 0xff}));
  EXPECT_EQ(run.exit_code, 0) << run.out << run.err;
  test::expectPart(run.out, "Kinect v2");
  test::expectPart(run.out, "012345643247");
  test::expectPart(run.out, "1-3");
  test::expectPart(run.out, "USB 3, 5000 Mbit/s");
}

TEST(DevicesApp, SaysWhatDoesNotWork) {
  const auto run = devices(test::mockText({1, 3, "1-2", 0x045e, 0x02c4, 480, "012345643247", 0xff}));
  EXPECT_EQ(run.exit_code, 4) << run.err;
  test::expectPart(run.out, "hangs on USB 2");
}

TEST(DevicesApp, NoCameraIsHardwareAbsent) {
  const auto run = devices("");
  EXPECT_EQ(run.exit_code, 5) << run.err;
}

TEST(DevicesApp, WatchTellsWhoIsThereUntilItIsStopped) {
  const test::TemporaryFolder folder;
  const auto file = folder.write(
      "usb.umockdev", test::mockBus(1, 480) + test::mockText({1, 4, "1-1", 0x045e, 0x02ae, 480, "A1", 0xff}));
  const auto run =
      test::runProgram(std::string(SERVOCAL_UMOCKDEV_RUN) + " -d " + test::shellWord(file.string()) +
                       " -- timeout --preserve-status --signal=INT 2 " SERVOCAL_DEVICES " --watch");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  test::expectPart(run.out, "+ Kinect v1 at port 1-1");
}

}  // namespace
}  // namespace servocal
