// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "database.h"
#include "servocal/core/observation.h"
#include "servocal/session/session.h"

namespace servocal::session {

/// Of image files, by their names in the session.
using ImageHashes = std::map<std::string, std::string>;

/// What the session's tables hold, one function per direction. Numbers read back as they were stored.
void insertObservation(const Database& database, const Observation& observation, const ImageHashes& hashes);

/// Reads observations one by one, of any readable version.
/// @throws Error (kBadData) if the database cannot be read or holds what is no observation.
class ObservationReader {
 public:
  explicit ObservationReader(const Database& database);
  /// Rising.
  std::vector<std::int64_t> ids();
  Observation read(std::int64_t id);
  /// Of the image files of an observation; empty where none is stored.
  ImageHashes hashes(std::int64_t id);

 private:
  std::optional<BoardDepth> readDepth(std::int64_t view_id);

  const Database& database_;
  bool has_hashes_;
  Statement robot_, views_, corners_;
  struct DepthStatements {
    explicit DepthStatements(const Database& database);
    Statement view, corners, patches;
  };
  std::optional<DepthStatements> depth_;
};

/// All of them.
std::vector<Observation> selectObservations(const Database& database);

/// Gives it the next id if it has none.
std::int64_t insertAttempt(const Database& database, const Attempt& attempt);
/// All, or one.
std::vector<Attempt> selectAttempts(const Database& database, std::optional<std::int64_t> id = std::nullopt);

void insertEvent(const Database& database, const SessionEvent& event);
std::vector<SessionEvent> selectEvents(const Database& database,
                                       std::optional<std::int64_t> id = std::nullopt);

}  // namespace servocal::session
