// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdio>
#include <map>

#include "servocal/core/cell_config.h"
#include "servocal/core/error.h"
#include "servocal/session/check.h"

namespace servocal::session {
namespace {

using Counts = std::map<std::string, int>;

std::string listed(const Counts& counts) {
  std::string text;
  for (const auto& [name, count] : counts)
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + name;
  return text.empty() ? "none" : text;
}

std::string cellName(const Session& session) {
  try {
    return "'" + parseCell(session.cellText(), "cell file").name + "'";
  } catch (const Error&) {
    return "that cannot be read";
  }
}

std::string seconds(Instant stamp) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", toSeconds(stamp.time_since_epoch()));
  return text;
}

}  // namespace

std::string describeSession(const Session& session) {
  constexpr std::size_t kLastEvents = 5;
  const std::vector<Observation> observations = session.observations();
  const std::vector<Attempt> attempts = session.attempts();
  const std::vector<SessionEvent> events = session.events();
  Counts stages, views, endings;
  for (const Observation& observation : observations) {
    ++stages[observation.stage];
    for (const StreamObservation& view : observation.views)
      ++views[view.camera + " " + toString(view.stream)];
  }
  for (const Attempt& attempt : attempts) ++endings[toString(attempt.status)];

  std::string text = "Session " + session.folder().string() + ", cell " + cellName(session) + ", seed " +
                     std::to_string(session.seed()) + "\n";
  if (!session.programs().empty()) text += "Written by " + session.programs() + "\n";
  text += "Board: " + session.board().describe() + "\n";
  text += std::to_string(observations.size()) + " observations: " + listed(stages) + "\n";
  text += "Views: " + listed(views) + "\n";
  text += std::to_string(attempts.size()) + " attempts: " + listed(endings) + "\n";
  std::error_code ignored;
  text += std::filesystem::exists(session.folder() / "result.yaml", ignored)
              ? "Result: result.yaml\n"
              : "No result: the run did not end. What was observed can be solved, or the run resumed.\n";
  const std::size_t first = events.size() > kLastEvents ? events.size() - kLastEvents : 0;
  for (std::size_t i = first; i < events.size(); ++i) {
    text += "  " + seconds(events[i].stamp) + "  " + events[i].kind + ": " + events[i].message + "\n";
  }
  return text;
}

}  // namespace servocal::session
