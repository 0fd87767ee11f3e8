// SPDX-License-Identifier: GPL-3.0-or-later
// The run as the report tells it, from drives and log, in one piece and in several.
#include "timeline.h"

#include <gtest/gtest.h>

namespace servocal::report {
namespace {

LogLine line(double at_s, const std::string& kind, const std::string& message) {
  return {Instant(fromSeconds(at_s)), kind, message};
}

Attempt drive(std::int64_t id, double start_s, double end_s) {
  Attempt attempt;
  attempt.id = id;
  attempt.stage = "cover";
  attempt.camera = "cam1";
  attempt.start = Instant(fromSeconds(start_s));
  attempt.end = Instant(fromSeconds(end_s));
  attempt.status = DriveStatus::kReached;
  return attempt;
}

std::vector<std::string> column(const Json& rows, const char* key) {
  std::vector<std::string> texts;
  for (const Json& row : rows)
    texts.push_back(row[key].is_string() ? row[key].get<std::string>() : row[key].dump());
  return texts;
}

using Texts = std::vector<std::string>;

TEST(Timeline, OneRunToItsEnd) {
  ReportInput input;
  input.log = {line(0, "begin", "0"),
               line(0, "options", "everything"),
               line(1, "stage", "tilt: cam1 color"),
               line(4, "tilt limit", "cam1 color roll+ 45 cap"),
               line(4, "tilt", "cam1 color: roll+ 45 deg, ended by cap"),
               line(9, "stage", "cover: cam1 infrared"),
               line(20, "end", "Goal met.")};
  input.attempts = {drive(1, 2, 4), drive(2, 10, 15)};
  const Json tree = timelineData(input);
  EXPECT_EQ(column(tree["stages"], "stage"), (Texts{"tilt", "cover"}));
  EXPECT_EQ(column(tree["stages"], "of"), (Texts{"cam1 color", "cam1 infrared"}));
  EXPECT_EQ(column(tree["stages"], "start_s"), (Texts{"1.0", "9.0"}));
  EXPECT_EQ(column(tree["stages"], "end_s"), (Texts{"9.0", "20.0"}));
  EXPECT_EQ(column(tree["log"], "kind"), (Texts{"note", "end"}));
  EXPECT_EQ(column(tree["log"], "text"), (Texts{"cam1 color: roll+ 45 deg, ended by cap", "Goal met."}));
  EXPECT_EQ(column(tree["drives"], "start_s"), (Texts{"2.0", "10.0"}));
}

// Stopped by the operator, resumed, killed, resumed, and ended by a fault: each clock starts at zero, the
// report's goes on.
TEST(Timeline, PartsOfARunFollowEachOther) {
  ReportInput input;
  input.log = {line(0, "begin", "0"),
               line(1, "stage", "cover: cam1 color"),
               line(20, "interrupted", "Stopped by the operator."),
               line(0, "begin", "2"),
               line(1, "stage", "resume: cam1 color"),
               line(3, "resume", "OK."),
               line(0, "begin", "3"),
               line(2, "stage", "cover: cam1 color"),
               line(30, "fault", "The arm made a protective stop."),
               line(31, "arm", "12 packages")};
  input.attempts = {drive(1, 2, 5), drive(2, 6, 19), drive(3, 4, 9), drive(4, 3, 8)};
  const Json tree = timelineData(input);
  EXPECT_EQ(column(tree["drives"], "start_s"), (Texts{"2.0", "6.0", "24.0", "32.0"}));
  EXPECT_EQ(column(tree["drives"], "end_s"), (Texts{"5.0", "19.0", "29.0", "37.0"}));
  EXPECT_EQ(column(tree["log"], "kind"),
            (Texts{"interrupted", "resumed", "note", "lost", "resumed", "fault", "arm"}));
  EXPECT_EQ(column(tree["log"], "at_s"), (Texts{"20.0", "20.0", "23.0", "29.0", "29.0", "59.0", "60.0"}));
  EXPECT_EQ(column(tree["stages"], "end_s"), (Texts{"20.0", "29.0", "59.0"}));
}

// Sessions of older programs have neither begin nor stages in their log: nothing is made up.
TEST(Timeline, AnOlderLogTellsWhatItHas) {
  ReportInput input;
  input.log = {line(1, "find", "cam2 color: not found")};
  input.attempts = {drive(1, 2, 5)};
  const Json tree = timelineData(input);
  EXPECT_EQ(column(tree["log"], "kind"), Texts{"note"});
  EXPECT_EQ(tree["stages"].size(), 0u);
  EXPECT_EQ(tree["drives"].size(), 1u);
  EXPECT_EQ(timelineData(ReportInput{})["log"].size(), 0u);
}

}  // namespace
}  // namespace servocal::report
