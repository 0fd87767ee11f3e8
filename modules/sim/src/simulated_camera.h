// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "camera_truth.h"
#include "depth_renderer.h"
#include "frame_schedule.h"
#include "gray_renderer.h"
#include "scene.h"
#include "servocal/core/clock.h"
#include "servocal/sensor/rgbd_camera.h"

namespace servocal::sim {

/// A free-running camera: color, and infrared with depth if it has them. Each stream is stamped with the
/// middle of its exposure; depth is the infrared's exposures. Only frames that are read are rendered.
///
/// If color and infrared exclude each other, the one that was asked for last runs; the other one's frames
/// begin `switch_s` after somebody asks for them.
class SimulatedCamera final : public sensor::RgbdCamera {
 public:
  SimulatedCamera(Clock& clock, Scene& scene, const CameraConfig& camera,
                  const SimulatedCameraConfig& simulated, std::uint64_t seed);

  const sensor::CameraInfo& info() const override { return info_; }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override;

  const CameraTruth& truth() const { return truth_; }
  std::int64_t framesRendered() const { return frames_rendered_; }

 private:
  enum class Side { kColor, kInfrared };
  struct Faults {
    double clock_offset_s = 0.0;
    double late_s = 0.0;
    double depth_unit_m = 0.001;
    bool inkjet = false;
    std::vector<SimulationFault> exposure;  ///< By time; the last that has begun counts.
    std::vector<SimulationFault> slow;      ///< Likewise.
  };
  static Faults faultsOf(const SimulationConfig& simulation, const std::string& camera);

  bool has(Stream stream) const;
  const FrameSchedule& schedule(Side side) const;
  void activate(Side side);
  /// A frame that never leaves the camera.
  bool isLost(const FrameSchedule& frames, std::int64_t index) const;
  /// As another exposure or another light would have made it.
  cv::Mat exposed(const cv::Mat& image, Stream stream, std::int64_t index, Instant stamp) const;
  sensor::Frame expose(Stream stream, std::int64_t index);
  cv::Mat colorImage(std::int64_t index);
  cv::Mat infraredImage(std::int64_t index);
  cv::Mat depthImage(std::int64_t index);

  Clock& clock_;
  Scene& scene_;
  CameraConfig camera_;
  SimulatedCameraConfig config_;
  std::uint64_t seed_;
  CameraTruth truth_;
  Faults faults_;
  sensor::CameraInfo info_;
  double device_clock_offset_s_;
  double device_clock_rate_;  ///< Device seconds per second.
  FrameSchedule color_schedule_;
  std::optional<FrameSchedule> infrared_schedule_;
  Side running_ = Side::kColor;  ///< The only side that runs, if they exclude each other.
  Instant running_from_{Duration::min()};
  std::unique_ptr<GrayRenderer> color_renderer_;  ///< Made for the first frame that is read, as the others.
  std::unique_ptr<GrayRenderer> infrared_renderer_;
  std::unique_ptr<DepthRenderer> depth_renderer_;
  std::array<std::int64_t, 3> last_frame_{-1, -1, -1};  ///< By stream.
  std::int64_t frames_rendered_ = 0;
};

}  // namespace servocal::sim
