// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/sensor_v4l2/camera.h"

#include "capture_camera.h"

namespace servocal::v4l2 {

OpenedCamera openCamera(const CameraConfig& config, Clock& clock, const OpenOptions& options) {
  const auto open = [](const Node& node) {
    return std::make_unique<cv::VideoCapture>(node.path.string(), cv::CAP_V4L2);
  };
  return openFrom(config, clock, options, {[config] { return findNode(config); }, open});
}

}  // namespace servocal::v4l2
