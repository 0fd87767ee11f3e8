// SPDX-License-Identifier: GPL-3.0-or-later
#include "sim_truth.h"

#include "cell_impl.h"

namespace servocal::sim {
namespace {

CameraModel modelOf(const Lens& lens) {
  CameraModel model;
  model.lens = LensModel::kPlumbBob;
  model.width_px = lens.width_px;
  model.height_px = lens.height_px;
  model.parameters.resize(9);
  model.parameters << lens.fx, lens.fy, lens.cx, lens.cy, lens.k1, lens.k2, lens.p1, lens.p2, lens.k3;
  return model;
}

}  // namespace

Truth::Truth(Cell& cell) : impl_(cell.impl_.get()) {}

CameraModel Truth::camera(const std::string& name) const {
  return modelOf(impl_->cameras.at(name)->truth().lens);
}

const InfraredTruth& Truth::infraredOf(const std::string& camera) const {
  return impl_->cameras.at(camera)->truth().infrared.value();
}

CameraModel Truth::infrared(const std::string& name) const { return modelOf(infraredOf(name).lens); }

Pose<Color, Infrared> Truth::cMi(const std::string& camera) const {
  return Pose<Color, Infrared>(infraredOf(camera).cMi);
}

double Truth::trueDepth(const std::string& camera, const Eigen::Vector2d& pixel, double measured_m) const {
  return infraredOf(camera).depth.value().trueDepth(pixel, measured_m);
}

double Truth::measuredDepth(const std::string& camera, const Eigen::Vector2d& pixel, double true_m) const {
  return infraredOf(camera).depth.value().measured(pixel, true_m);
}

Pose<Base, Color> Truth::bMc(const std::string& camera) const { return bMc(camera, impl_->clock.now()); }

Pose<Base, Color> Truth::bMc(const std::string& camera, Instant instant) const {
  const Eigen::Isometry3d& pose = impl_->cameras.at(camera)->truth().pose.at(instant);
  if (impl_->scene->boardOnFlange()) return Pose<Base, Color>(pose);
  return Pose<Base, Color>(impl_->arm->flangeAt(instant) * pose);
}

Pose<EndEffector, Color> Truth::eMc(const std::string& camera, Instant instant) const {
  return Pose<EndEffector, Color>(impl_->cameras.at(camera)->truth().pose.at(instant));
}

Pose<EndEffector, Board> Truth::eMo() const { return eMo(impl_->clock.now()); }

Pose<EndEffector, Board> Truth::eMo(Instant instant) const {
  return Pose<EndEffector, Board>(impl_->scene->mount().at(instant));
}

Pose<Base, Board> Truth::bMo(Instant instant) const {
  const Eigen::Isometry3d& mount = impl_->scene->mount().at(instant);
  if (!impl_->scene->boardOnFlange()) return Pose<Base, Board>(mount);
  return Pose<Base, Board>(impl_->arm->flangeAt(instant) * mount);
}

Pose<Base, EndEffector> Truth::bMe() const { return bMe(impl_->clock.now()); }

Pose<Base, EndEffector> Truth::bMe(Instant instant) const {
  return Pose<Base, EndEffector>(impl_->arm->flangeAt(instant));
}

Pose<Base, EndEffector> Truth::bMe(const Eigen::VectorXd& q) const {
  return Pose<Base, EndEffector>(impl_->arm->flangeOf(q));
}

Eigen::VectorXd Truth::q() const { return q(impl_->clock.now()); }
Eigen::VectorXd Truth::q(Instant instant) const { return impl_->arm->jointsAt(instant); }

Pose<Color, Board> Truth::cMo(const std::string& camera, Instant instant) const {
  return bMc(camera, instant).inverse() * bMo(instant);
}

std::vector<Eigen::Vector2d> Truth::corners(const std::string& camera, Instant instant, Stream stream) const {
  const CameraTruth& truth = impl_->cameras.at(camera)->truth();
  const bool color = stream == Stream::kColor;
  const Lens& lens = color ? truth.lens : infraredOf(camera).lens;
  Eigen::Isometry3d pose = cMo(camera, instant).isometry();
  if (!color) pose = cMi(camera).inverse().isometry() * pose;
  std::vector<Eigen::Vector2d> pixels;
  for (const Eigen::Vector3d& corner : impl_->config.board.corners()) {
    pixels.push_back(lens.project(pose * corner));
  }
  return pixels;
}

std::int64_t Truth::framesRendered(const std::string& camera) const {
  return impl_->cameras.at(camera)->framesRendered();
}

}  // namespace servocal::sim
