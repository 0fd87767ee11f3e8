// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>

#include "color_renderer.h"
#include "servocal/core/clock.h"
#include "servocal/core/pose.h"
#include "servocal/sensor/rgbd_camera.h"
#include "simulated_arm.h"

namespace servocal::sim {

/// A free-running color camera fixed in the cell. Frame k is exposed from k / rate on, stamped with the
/// middle of its exposure and delivered `latency` after its end. Only frames that are read are rendered.
class SimulatedCamera final : public sensor::RgbdCamera {
 public:
  /// The truth of one seed.
  struct Draw {
    Lens lens;
    Eigen::Isometry3d bMc;
    Light light;
  };
  static Draw draw(const CameraConfig& camera, const SimulatedCameraConfig& simulated,
                   const SimulationConfig& simulation, std::uint64_t seed);

  SimulatedCamera(SimulatedClock& clock, SimulatedArm& arm, const BoardSpec& board,
                  const Eigen::Isometry3d& eMo, const CameraConfig& camera,
                  const SimulatedCameraConfig& simulated, const SimulationConfig& simulation,
                  std::uint64_t seed);

  const sensor::CameraInfo& info() const override { return info_; }
  std::optional<sensor::Frame> next(Stream stream, Instant deadline) override;

  const Draw& truth() const { return truth_; }
  std::int64_t framesRendered() const { return frames_rendered_; }

 private:
  Instant exposureBegin(std::int64_t frame) const;
  Instant delivery(std::int64_t frame) const;
  std::int64_t newestDelivered(Instant now) const;  ///< -1: none yet.
  sensor::Frame expose(std::int64_t frame);
  std::vector<Capsule> armLinks(Instant instant) const;

  SimulatedClock& clock_;
  SimulatedArm& arm_;
  BoardSpec board_;
  Eigen::Isometry3d eMo_;
  SimulatedCameraConfig config_;
  bool clutter_;
  std::uint64_t seed_;
  Draw truth_;
  sensor::CameraInfo info_;
  double device_clock_offset_s_;
  std::unique_ptr<ColorRenderer> renderer_;  ///< Made for the first frame that is read.
  std::int64_t last_frame_ = -1;
  std::int64_t frames_rendered_ = 0;
};

}  // namespace servocal::sim
