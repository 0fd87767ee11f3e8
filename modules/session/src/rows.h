// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "database.h"
#include "servocal/core/observation.h"

namespace servocal::session {

/// What the session's tables hold, one function per direction. Numbers read back as they were stored.
void insertObservation(const Database& database, const Observation& observation);
std::vector<Observation> selectObservations(const Database& database);

std::int64_t insertAttempt(const Database& database, const Attempt& attempt);
std::vector<Attempt> selectAttempts(const Database& database);

}  // namespace servocal::session
