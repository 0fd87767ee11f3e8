// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "servocal/core/cell_config.h"
#include "servocal/core/pose.h"

namespace servocal {

/// The arm's pose as the chain from a camera to the board wants it. Fixed cameras: cMo = bMc^-1 bMe eMo. Cameras on
/// the flange: cMo = eMc^-1 bMe^-1 bMo; so with bMe^-1 in the place of bMe, eMc in that of bMc and bMo in that of
/// eMo, one code serves both. Its own inverse: it takes such a pose back to bMe as well.
inline Pose<Base, EndEffector> forMount(Mount mount, const Pose<Base, EndEffector>& bMe) {
  return mount == Mount::kFixed ? bMe : relabel<Base, EndEffector>(bMe.inverse());
}

}  // namespace servocal
