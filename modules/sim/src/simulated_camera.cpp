// SPDX-License-Identifier: GPL-3.0-or-later
#include "simulated_camera.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "background.h"
#include "faults.h"
#include "projector_dots.h"

namespace servocal::sim {
namespace {

constexpr double kInfraredWhite = 165.0;
constexpr double kInkjetBlack = 0.96;  // Dye ink lets infrared through to the paper.

/// Of faults in order of their time the last that has begun; null if none has.
const SimulationFault* lastBegun(const std::vector<SimulationFault>& faults, Instant now) {
  const SimulationFault* last = nullptr;
  for (const SimulationFault& fault : faults) {
    if (fault.at_s <= toSeconds(now)) last = &fault;
  }
  return last;
}

}  // namespace

SimulatedCamera::Faults SimulatedCamera::faultsOf(const SimulationConfig& simulation,
                                                  const std::string& camera) {
  Faults faults;
  for (const SimulationFault& fault : faultsInOrder(simulation)) {
    if (fault.kind == FaultKind::kInkjetPrint) faults.inkjet = true;
    if (fault.camera != camera) continue;
    if (fault.kind == FaultKind::kClockOffset) faults.clock_offset_s += fault.offset_s;
    if (fault.kind == FaultKind::kLateDelivery) faults.late_s += fault.offset_s;
    if (fault.kind == FaultKind::kDepthUnit) faults.depth_unit_m = fault.unit_m;
    if (fault.kind == FaultKind::kExposure) faults.exposure.push_back(fault);
    if (fault.kind == FaultKind::kSlowFrames) faults.slow.push_back(fault);
  }
  return faults;
}

SimulatedCamera::SimulatedCamera(Clock& clock, Scene& scene, const CameraConfig& camera,
                                 const SimulatedCameraConfig& simulated, std::uint64_t seed)
    : clock_(clock), scene_(scene), camera_(camera), config_(simulated), seed_(seed),
      truth_(drawCamera(camera, simulated, scene.simulation(), seed)),
      faults_(faultsOf(scene.simulation(), camera.name)),
      color_schedule_(simulated, 0.0, faults_.late_s, simulated.delivery_jitter_s,
                      Random(seed, "color delivery " + camera.name).bits()) {
  info_.name = camera.name;
  info_.model = camera.infrared ? "simulated RGB-D camera" : "simulated color camera";
  info_.serial = "sim-" + camera.name + "-" + std::to_string(seed);
  const bool exclusive = camera.infrared && camera.infrared->excludes_color;
  info_.streams = {{Stream::kColor, camera.width_px, camera.height_px, simulated.rate_hz, exclusive}};
  if (truth_.infrared) {
    const SimulatedInfraredConfig& infrared = truth_.infrared->config;
    infrared_schedule_.emplace(infrared, truth_.infrared->phase_s, faults_.late_s,
                               simulated.delivery_jitter_s,
                               Random(seed, "infrared delivery " + camera.name).bits());
    const auto add = [&](Stream stream) {
      info_.streams.push_back(
          {stream, camera.infrared->width_px, camera.infrared->height_px, infrared.rate_hz, exclusive});
    };
    add(Stream::kInfrared);
    if (truth_.infrared->depth) add(Stream::kDepth);
  }
  Random clock_random(seed, "clock " + camera.name);
  device_clock_offset_s_ = clock_random.uniform(100.0, 10000.0);
  device_clock_rate_ = 1.0 + 1e-6 * clock_random.uniform(-1.0, 1.0) * simulated.clock_drift_ppm;
}

bool SimulatedCamera::has(Stream stream) const {
  return std::any_of(info_.streams.begin(), info_.streams.end(),
                     [&](const sensor::StreamMode& mode) { return mode.stream == stream; });
}

const FrameSchedule& SimulatedCamera::schedule(Side side) const {
  return side == Side::kColor ? color_schedule_ : *infrared_schedule_;
}

void SimulatedCamera::activate(Side side) {
  if (side == running_ || !camera_.infrared || !camera_.infrared->excludes_color) return;
  running_ = side;
  running_from_ = clock_.now() + fromSeconds(config_.switch_s);
}

bool SimulatedCamera::isLost(const FrameSchedule& frames, std::int64_t index) const {
  const SimulationFault* const slow = lastBegun(faults_.slow, frames.exposed(index, 0.5));
  if (slow == nullptr) return false;
  const double share = slow->rate_hz / frames.rateHz(), count = static_cast<double>(index);
  return share < 1.0 && std::floor(share * count) == std::floor(share * (count - 1.0));
}

cv::Mat SimulatedCamera::exposed(const cv::Mat& image, Stream stream, std::int64_t index,
                                 Instant stamp) const {
  const SimulationFault* const exposure = lastBegun(faults_.exposure, stamp);
  if (exposure == nullptr) return image;
  Random random(seed_ ^ scramble(static_cast<std::uint64_t>(index)),
                std::string("exposure ") + toString(stream) + info_.name);
  cv::Mat brighter;
  image.convertTo(brighter, -1, exposure->gain * (1.0 + exposure->flicker * random.uniform(-1.0, 1.0)));
  return brighter;
}

std::optional<sensor::Frame> SimulatedCamera::next(Stream stream, Instant deadline) {
  if (!has(stream)) {
    throw std::invalid_argument("camera '" + info_.name + "' has no " + toString(stream) + " stream");
  }
  const Side side = stream == Stream::kColor ? Side::kColor : Side::kInfrared;
  activate(side);
  const FrameSchedule& frames = schedule(side);
  std::int64_t& last = last_frame_[static_cast<std::size_t>(stream)];
  std::int64_t earliest = last + 1;
  if (running_from_ > Instant{}) earliest = std::max(earliest, frames.firstExposedFrom(running_from_));
  std::int64_t frame = frames.newestDelivered(clock_.now());
  while (frame >= earliest && isLost(frames, frame)) --frame;
  if (frame < earliest) {
    frame = std::max(earliest, frames.newestDelivered(clock_.now()) + 1);
    while (isLost(frames, frame)) ++frame;
    if (frames.delivered(frame) > deadline) {
      clock_.sleepUntil(deadline);
      return std::nullopt;
    }
    clock_.sleepUntil(frames.delivered(frame));
  }
  last = frame;
  return expose(stream, frame);
}

sensor::Frame SimulatedCamera::expose(Stream stream, std::int64_t index) {
  const FrameSchedule& frames = schedule(stream == Stream::kColor ? Side::kColor : Side::kInfrared);
  const Instant middle = frames.exposed(index, 0.5);
  sensor::Frame frame;
  frame.stream = stream;
  switch (stream) {
    case Stream::kColor: frame.image = exposed(colorImage(index), stream, index, middle); break;
    case Stream::kInfrared: frame.image = exposed(infraredImage(index), stream, index, middle); break;
    case Stream::kDepth: frame.image = depthImage(index); break;
  }
  frame.stamp = middle + fromSeconds(faults_.clock_offset_s);
  frame.received = frames.delivered(index);
  frame.device_stamp_s = toSeconds(frame.stamp) * device_clock_rate_ + device_clock_offset_s_;
  frame.sequence = static_cast<std::uint64_t>(index);
  ++frames_rendered_;
  return frame;
}

cv::Mat SimulatedCamera::colorImage(std::int64_t index) {
  if (!color_renderer_) {
    Random random(seed_, "background " + info_.name);
    const cv::Mat background =
        drawBackground(truth_.lens.width_px, truth_.lens.height_px, scene_.simulation().clutter, random);
    color_renderer_ = std::make_unique<GrayRenderer>(scene_.config().board, truth_.lens, truth_.light,
                                                     Tones{}, config_, background);
  }
  // Noise depends on the frame's number, not on which frames were read before.
  Random noise(seed_ ^ scramble(static_cast<std::uint64_t>(index)), "noise " + info_.name);
  const auto cMo = [&](double fraction) {
    return scene_.cMo(truth_.pose, color_schedule_.exposed(index, fraction));
  };
  return color_renderer_->render(cMo, scene_.armLinks(truth_.pose, color_schedule_.exposed(index, 0.5)),
                                 noise);
}

cv::Mat SimulatedCamera::infraredImage(std::int64_t index) {
  const InfraredTruth& infrared = *truth_.infrared;
  if (!infrared_renderer_) {
    Random random(seed_, "infrared background " + info_.name);
    const cv::Mat background =
        drawBackground(infrared.lens.width_px, infrared.lens.height_px, scene_.simulation().clutter, random);
    const double black = faults_.inkjet ? kInkjetBlack : infrared.config.black;
    const Tones tones{kInfraredWhite, black * kInfraredWhite, 0.3 * kInfraredWhite};
    infrared_renderer_ = std::make_unique<GrayRenderer>(scene_.config().board, infrared.lens, infrared.light,
                                                        tones, infrared.config, background);
  }
  Random noise(seed_ ^ scramble(static_cast<std::uint64_t>(index)), "infrared noise " + info_.name);
  const Eigen::Isometry3d iMc = infrared.cMi.inverse();
  const auto iMo = [&](double fraction) -> Eigen::Isometry3d {
    return iMc * scene_.cMo(truth_.pose, infrared_schedule_->exposed(index, fraction));
  };
  std::vector<Capsule> links = scene_.armLinks(truth_.pose, infrared_schedule_->exposed(index, 0.5));
  for (Capsule& link : links) {
    link.from = iMc * link.from;
    link.to = iMc * link.to;
    link.gray *= Light::kActiveOnWall;
  }
  const cv::Mat image = infrared_renderer_->render(iMo, links, noise);
  const bool dots = infrared.config.projector_dots && infrared.depth &&
                    infrared.depth->sensor() == DepthSensor::kStructuredLight;
  if (!dots) return image;
  const double focal_baseline = infrared.depth->focalBaseline() / faults_.depth_unit_m;
  return withProjectorDots(image, depthImage(index), focal_baseline, seed_);
}

cv::Mat SimulatedCamera::depthImage(std::int64_t index) {
  const InfraredTruth& infrared = *truth_.infrared;
  if (!depth_renderer_) {
    DepthRenderer::Scene seen;
    seen.wall_distance_m = scene_.simulation().wall_distance_m;
    seen.specular = infrared.light.specular;
    seen.black_shows = !faults_.inkjet;
    seen.unit_m = faults_.depth_unit_m;
    depth_renderer_ = std::make_unique<DepthRenderer>(scene_.config().board, infrared.lens,
                                                      infrared.config.depth, *infrared.depth, seen,
                                                      Random(seed_, "depth pattern " + info_.name).bits());
  }
  Random noise(seed_ ^ scramble(static_cast<std::uint64_t>(index)), "depth noise " + info_.name);
  const Instant middle = infrared_schedule_->exposed(index, 0.5);
  return depth_renderer_->render(infrared.cMi.inverse() * scene_.cMo(truth_.pose, middle), noise);
}

}  // namespace servocal::sim
