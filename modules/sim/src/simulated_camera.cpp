// SPDX-License-Identifier: GPL-3.0-or-later
#include "simulated_camera.h"

#include <cmath>
#include <stdexcept>

namespace servocal::sim {
namespace {

/// A camera at `position` that looks at a point, its x axis horizontal and y down.
Eigen::Isometry3d lookAt(const Eigen::Vector3d& position, const Eigen::Vector3d& target) {
  const Eigen::Vector3d z = (target - position).normalized();
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  if (!z.allFinite() || !x.allFinite()) {
    throw std::invalid_argument("sim::Cell: a simulated camera must look at another point, not along z");
  }
  Eigen::Isometry3d bMc = Eigen::Isometry3d::Identity();
  bMc.linear() << x, z.cross(x), z;
  bMc.translation() = position;
  return bMc;
}

Light drawLight(const SimulationConfig& simulation, const Lens& lens, const Eigen::Isometry3d& bMc,
                Random& random) {
  Light light;
  light.specular = simulation.specular;
  // A lamp above and behind the camera, off to a side.
  const Eigen::Vector3d back = -bMc.linear().col(2), side = bMc.linear().col(0);
  const Eigen::Vector3d towards =
      0.7 * back + random.uniform(-0.5, 0.5) * side + random.uniform(0.5, 0.9) * Eigen::Vector3d::UnitZ();
  light.towards_c = bMc.linear().transpose() * towards.normalized();
  // The light falls from 1 to 1 - gradient from one end of the image's diagonal circle to the other.
  const double angle = random.uniform(0.0, 2.0 * M_PI);
  const Eigen::Vector2d direction(std::cos(angle), std::sin(angle));
  const Eigen::Vector2d centre(0.5 * lens.width_px, 0.5 * lens.height_px);
  light.fall_per_px = direction * simulation.light_gradient / (2.0 * centre.norm());
  light.fall_at_origin = 0.5 * simulation.light_gradient - light.fall_per_px.dot(centre);
  return light;
}

}  // namespace

SimulatedCamera::Draw SimulatedCamera::draw(const CameraConfig& camera,
                                            const SimulatedCameraConfig& simulated,
                                            const SimulationConfig& simulation, std::uint64_t seed) {
  Random lens_random(seed, "lens " + camera.name);
  Random pose_random(seed, "pose " + camera.name);
  Random light_random(seed, "light " + camera.name);
  Draw draw;
  draw.lens = Lens::draw(simulated, camera.width_px, camera.height_px, lens_random);
  draw.bMc = lookAt(simulated.position_m, simulated.look_at_m);
  draw.bMc.translation() += pose_random.box(simulated.position_spread_m);
  const Eigen::Vector3d axis = pose_random.direction();
  const double angle = pose_random.uniform(0.0, simulated.rotation_spread_rad);
  draw.bMc.linear() = draw.bMc.linear() * Eigen::AngleAxisd(angle, axis);
  draw.light = drawLight(simulation, draw.lens, draw.bMc, light_random);
  return draw;
}

SimulatedCamera::SimulatedCamera(SimulatedClock& clock, SimulatedArm& arm, const BoardSpec& board,
                                 const Eigen::Isometry3d& eMo, const CameraConfig& camera,
                                 const SimulatedCameraConfig& simulated,
                                 const SimulationConfig& simulation, std::uint64_t seed)
    : clock_(clock),
      arm_(arm),
      board_(board),
      eMo_(eMo),
      config_(simulated),
      clutter_(simulation.clutter),
      seed_(seed),
      truth_(draw(camera, simulated, simulation, seed)) {
  info_.name = camera.name;
  info_.model = "simulated color camera";
  info_.serial = "sim-" + camera.name + "-" + std::to_string(seed);
  info_.streams = {{Stream::kColor, camera.width_px, camera.height_px, simulated.rate_hz, false}};
  device_clock_offset_s_ = Random(seed, "clock " + camera.name).uniform(100.0, 10000.0);
}

Instant SimulatedCamera::exposureBegin(std::int64_t frame) const {
  return Instant(Duration(std::llround(1e9 * static_cast<double>(frame) / config_.rate_hz)));
}

Instant SimulatedCamera::delivery(std::int64_t frame) const {
  return exposureBegin(frame) + fromSeconds(config_.exposure_s + config_.latency_s);
}

std::int64_t SimulatedCamera::newestDelivered(Instant now) const {
  const double age_s = toSeconds(now) - config_.exposure_s - config_.latency_s;
  std::int64_t frame = std::max<std::int64_t>(-1, static_cast<std::int64_t>(age_s * config_.rate_hz) + 1);
  while (frame >= 0 && delivery(frame) > now) --frame;
  return frame;
}

std::optional<sensor::Frame> SimulatedCamera::next(Stream stream, Instant deadline) {
  if (stream != Stream::kColor) {
    throw std::invalid_argument("camera '" + info_.name + "' has no " + toString(stream) + " stream");
  }
  std::int64_t frame = newestDelivered(clock_.now());
  if (frame <= last_frame_) {
    frame = last_frame_ + 1;
    if (delivery(frame) > deadline) {
      clock_.sleepUntil(deadline);
      return std::nullopt;
    }
    clock_.sleepUntil(delivery(frame));
  }
  last_frame_ = frame;
  return expose(frame);
}

std::vector<Capsule> SimulatedCamera::armLinks(Instant instant) const {
  const Eigen::Isometry3d cMb = truth_.bMc.inverse();
  const auto frames = Ur5().frames(arm_.jointsAt(instant));
  // Thickness and gray of the links of a UR5, and of the board's holder.
  constexpr double kRadiusM[] = {0.075, 0.060, 0.050, 0.040, 0.040, 0.040};
  constexpr double kGray[] = {60.0, 150.0, 140.0, 60.0, 70.0, 50.0};
  std::vector<Capsule> links;
  for (int i = 0; i < 6; ++i) {
    links.push_back(
        {cMb * frames[i].translation(), cMb * frames[i + 1].translation(), kRadiusM[i], kGray[i]});
  }
  links.push_back({cMb * frames[6].translation(), cMb * (frames[6] * eMo_.translation()), 0.02, 45.0});
  return links;
}

sensor::Frame SimulatedCamera::expose(std::int64_t index) {
  if (!renderer_) {
    renderer_ = std::make_unique<ColorRenderer>(board_, truth_.lens, truth_.light, config_, clutter_, seed_);
  }
  const Instant begin = exposureBegin(index);
  const Eigen::Isometry3d cMb = truth_.bMc.inverse();
  const auto cMo = [&](double fraction) -> Eigen::Isometry3d {
    return cMb * arm_.flangeAt(begin + fromSeconds(fraction * config_.exposure_s)) * eMo_;
  };
  // Noise depends on the frame's number, not on which frames were read before.
  Random noise(seed_ ^ scramble(static_cast<std::uint64_t>(index)), "noise " + info_.name);
  sensor::Frame frame;
  frame.stream = Stream::kColor;
  frame.image = renderer_->render(cMo, armLinks(begin + fromSeconds(0.5 * config_.exposure_s)), noise);
  frame.stamp = begin + fromSeconds(0.5 * config_.exposure_s);
  frame.received = delivery(index);
  frame.device_stamp_s = toSeconds(frame.stamp) + device_clock_offset_s_;
  frame.sequence = static_cast<std::uint64_t>(index);
  ++frames_rendered_;
  return frame;
}

}  // namespace servocal::sim
