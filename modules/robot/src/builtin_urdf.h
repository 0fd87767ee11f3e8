// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace servocal::robot {

/// The text of data/ur5.urdf, inside the library so that a program needs no file beside it.
extern const char* const kUr5Urdf;

}  // namespace servocal::robot
