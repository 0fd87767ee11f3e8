// SPDX-License-Identifier: GPL-3.0-or-later
// A run that goes on where an earlier one stopped: what its session holds is taken over, not done again.
#pragma once

#include <set>
#include <string>

#include "run.h"

namespace servocal::procedure {

/// Takes over what the session holds: observations, beliefs, coverage, tilt limits. Then looks at a few of
/// the stored views again, before anything else is added. Of a new session nothing but what it is made with
/// is noted. Returns the cameras whose turn is over.
///
/// @throws Error (kRefusedToMove) if arm, cameras or options are not the session's.
/// @throws Error (kBadData) if a camera or the mount is not where it was.
std::set<std::string> takeOver(Run& run, const session::Session& session);

/// Notes in the session that a camera's turn is over.
void noteTurnOver(Run& run, const Eye& color);
/// Notes a tilt limit in the session.
void noteTiltLimit(Run& run, const Eye& eye, const TiltLimit& limit);
/// True if the search in this direction is over.
bool hasTiltLimit(const Eye& eye, const std::string& direction);

/// Views taken so far in a stage for a camera, of either stream.
int viewsTaken(const Run& run, const std::string& stage, const std::string& camera);
/// Views that an eye had in a stage at stops made for other eyes.
int viewsBesides(const Run& run, const std::string& stage, const Eye& eye);
/// Views taken so far in a stage for one eye; adds them to a coverage of the stage's own.
int viewsTaken(const Run& run, const std::string& stage, const Eye& eye, coverage::Coverage& coverage);

}  // namespace servocal::procedure
