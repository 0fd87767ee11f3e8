// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "servocal/core/clock.h"
#include "servocal/core/observation.h"

namespace servocal::sensor {

/// One image of one stream.
struct Frame {
  Stream stream = Stream::kColor;
  cv::Mat image;              ///< Color: CV_8UC1 or CV_8UC3 (BGR). Infrared: CV_8UC1 or CV_16UC1.
                              ///< Depth: CV_16UC1, mm.
  Instant stamp{};            ///< Middle of the exposure, on the run's clock.
  Instant received{};         ///< When it reached this program.
  double device_stamp_s = 0;  ///< The camera's own stamp.
  std::uint64_t sequence = 0; ///< Rises by one per frame of the stream.
};

struct StreamMode {
  Stream stream = Stream::kColor;
  int width_px = 0;
  int height_px = 0;
  double rate_hz = 0.0;
  bool exclusive = false;  ///< Cannot run together with the camera's other exclusive streams.
};

struct CameraInfo {
  std::string name;    ///< As in the cell file.
  std::string model;
  std::string serial;
  std::vector<StreamMode> streams;
};

/// A camera with one or more streams.
class RgbdCamera {
 public:
  virtual ~RgbdCamera() = default;
  virtual const CameraInfo& info() const = 0;
  /// The newest frame of the stream that was not handed out before; waits for one until `deadline`.
  /// Older frames that nobody fetched are dropped. Nothing if none came.
  /// An exclusive stream is switched on first if another one was running: then frames take longer to come.
  /// @throws Error (kHardwareAbsent) if the camera is gone.
  virtual std::optional<Frame> next(Stream stream, Instant deadline) = 0;
};

}  // namespace servocal::sensor
