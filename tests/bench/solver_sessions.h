// SPDX-License-Identifier: GPL-3.0-or-later
// A whole session, images and robot poses to intrinsics and camera pose: our joint solve beside what others
// chain.
#pragma once

#include <string>

#include "servocal/core/cell_config.h"

namespace servocal::test {

/// Synthetic sessions of one camera; errors against the truth.
void benchSessions(int seeds, Mount mount);

/// The real recordings that have robot poses; errors in views held out, the robot believed.
void benchRecordings(const std::string& root);

}  // namespace servocal::test
