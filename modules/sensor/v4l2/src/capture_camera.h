// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>
#include <memory>
#include <opencv2/videoio.hpp>

#include "find_node.h"
#include "servocal/sensor_v4l2/camera.h"

namespace servocal::v4l2 {

/// Finds the camera and opens it, each time it is to be opened.
struct Source {
  std::function<Node()> find;
  std::function<std::unique_ptr<cv::VideoCapture>(const Node&)> open;
};

/// openCamera() on any source: the kernel's, or a test's.
OpenedCamera openFrom(const CameraConfig& config, Clock& clock, const OpenOptions& options, Source source);

}  // namespace servocal::v4l2
