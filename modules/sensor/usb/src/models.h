// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <optional>

#include "servocal/sensor_usb/usb_cameras.h"

namespace servocal::usb {

/// By USB numbers; nothing: no camera of ours. Webcams are known by their class instead.
std::optional<CameraModel> knownModel(std::uint16_t vendor_id, std::uint16_t product_id);
CameraModel webcam();

}  // namespace servocal::usb
