// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "servocal/core/observation.h"
#include "servocal/core/result.h"

namespace servocal::report {

/// A line of a session's log.
struct LogLine {
  Instant stamp{};
  std::string kind, message;
};

/// What a report tells about. A result alone is enough; observations, attempts and log add what only they know:
/// residual vectors, depth errors, visited poses, hand-eye error against views, the timeline.
struct ReportInput {
  std::string source;  ///< Session folder or result file, for provenance.
  std::filesystem::path folder;  ///< The session's, where its images are; empty without a session.
  CalibrationResult result;
  std::vector<Observation> observations;
  std::vector<Attempt> attempts;
  std::vector<LogLine> log;
  std::string programs;              ///< What wrote the session, with versions; empty if unknown.
  std::string cell_text;             ///< The cell file; empty if unknown.
  double robot_accuracy_m = 0.0003;  ///< Declared in the cell file: 1 sigma per axis.
  double robot_accuracy_rad = 0.0005;
};

/// A session folder with its result.yaml, or a result file.
/// @throws Error (kBadData) if it cannot be read; (kNothingToDo) if the session was not solved yet.
ReportInput loadReportInput(const std::filesystem::path& session_or_result);

/// Everything the page shows, as JSON; docs/report.md explains the keys. Lengths and angles carry their unit
/// in the key.
std::string reportJson(const ReportInput& input);

}  // namespace servocal::report
