// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "temporary_folder.h"

namespace servocal::test {

/// A recording as libfreenect's "record" writes it and fakenect plays it: the same pictures again and again,
/// 30 times a second each, depth half a period after color.
class KinectRecording {
 public:
  /// @param rgb CV_8UC3, @param depth CV_16UC1, both 640 x 480; @param first_stamp of 60 MHz.
  KinectRecording(const cv::Mat& rgb, const cv::Mat& depth, double seconds, std::uint32_t first_stamp);
  const std::filesystem::path& path() const { return folder_.path(); }

 private:
  TemporaryFolder folder_;
};

}  // namespace servocal::test
