// SPDX-License-Identifier: GPL-3.0-or-later
#include "timeline.h"

#include <algorithm>
#include <cstdlib>
#include <set>

namespace servocal::report {
namespace {

/// From one begin of the program to the next: its clock starts at zero.
struct Part {
  std::int64_t after_drive = 0;  ///< The last drive before it.
  std::vector<LogLine> log;
  std::vector<Attempt> drives;
  Duration length{};

  void takesUntil(Instant instant) { length = std::max(length, instant.time_since_epoch()); }
};

std::vector<Part> partsOf(const ReportInput& input) {
  std::vector<Part> parts(1);
  for (const LogLine& line : input.log) {
    if (line.kind == "begin") {
      if (!parts.back().log.empty()) parts.emplace_back();
      parts.back().after_drive = std::atoll(line.message.c_str());
    }
    parts.back().log.push_back(line);
    parts.back().takesUntil(line.stamp);
  }
  for (const Attempt& drive : input.attempts) {
    const auto part =
        std::find_if(parts.rbegin(), parts.rend(), [&](const Part& of) { return drive.id > of.after_drive; });
    Part& its = part == parts.rend() ? parts.front() : *part;
    its.drives.push_back(drive);
    its.takesUntil(drive.end);
  }
  return parts;
}

/// Lines that the program reads again, and what is drawn in other ways.
bool isForPeople(const LogLine& line) {
  static const std::set<std::string> others = {"begin",  "stage",     "options",
                                               "device", "turn over", "tilt limit"};
  return others.count(line.kind) == 0;
}

/// What a line is to a reader: "end", "interrupted", "fault", "arm", else "note".
std::string kindOf(const LogLine& line) {
  for (const char* kind : {"end", "interrupted", "fault", "arm"}) {
    if (line.kind == kind) return kind;
  }
  return "note";
}

class Timeline {
 public:
  void add(const Part& part, bool resumed) {
    const auto seconds = [&](Instant instant) {
      return rounded(toSeconds(begin_ + instant.time_since_epoch()), 3);
    };
    for (const Attempt& drive : part.drives) {
      drives_.push_back({{"stage", drive.stage},
                         {"camera", drive.camera},
                         {"start_s", seconds(drive.start)},
                         {"end_s", seconds(drive.end)},
                         {"status", toString(drive.status)},
                         {"reason", drive.reason}});
    }
    if (resumed) say(seconds(Instant{}), "resumed", "The program was started again and went on.");
    const Instant end(part.length);
    bool ended = false;
    std::optional<Json> stage;
    const auto closeStage = [&](Instant instant) {
      if (!stage) return;
      (*stage)["end_s"] = seconds(instant);
      stages_.push_back(*std::move(stage));
      stage.reset();
    };
    for (const LogLine& line : part.log) {
      const std::string kind = kindOf(line);
      if (line.kind == "stage") {
        closeStage(line.stamp);
        const std::size_t colon = line.message.find(": ");  // "cover: cam1 color"
        stage = Json{{"stage", line.message.substr(0, colon)},
                     {"of", colon == std::string::npos ? "" : line.message.substr(colon + 2)},
                     {"start_s", seconds(line.stamp)}};
      }
      if (kind == "end" || kind == "interrupted" || kind == "fault") {
        closeStage(line.stamp);
        ended = true;
      }
      if (isForPeople(line)) say(seconds(line.stamp), kind, line.message);
    }
    closeStage(end);
    const bool knows_ends =
        !part.log.empty() && part.log.front().kind == "begin";  // Older programs wrote none.
    if (knows_ends && !ended)
      say(seconds(end), "lost", "The log ends here: the program was killed, or the power failed.");
    begin_ += part.length;
  }

  Json tree() && {
    return {{"drives", std::move(drives_)}, {"stages", std::move(stages_)}, {"log", std::move(log_)}};
  }

 private:
  void say(const Json& at_s, const std::string& kind, const std::string& text) {
    log_.push_back({{"at_s", at_s}, {"kind", kind}, {"text", text}});
  }

  Duration begin_{};
  Json drives_ = Json::array(), stages_ = Json::array(), log_ = Json::array();
};

}  // namespace

Json timelineData(const ReportInput& input) {
  Timeline timeline;
  const std::vector<Part> parts = partsOf(input);
  for (const Part& part : parts) timeline.add(part, &part != &parts.front());
  return std::move(timeline).tree();
}

}  // namespace servocal::report
