// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace servocal::robot::ur {

extern const char* const kServoScript;  ///< data/servo.script

}  // namespace servocal::robot::ur
