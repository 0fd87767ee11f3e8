// SPDX-License-Identifier: GPL-3.0-or-later
#include "sim_truth.h"

#include "cell_impl.h"

namespace servocal::sim {

Truth::Truth(Cell& cell) : impl_(cell.impl_.get()) {}

CameraModel Truth::camera(const std::string& name) const {
  const Lens& lens = impl_->cameras.at(name)->truth().lens;
  CameraModel model;
  model.lens = LensModel::kPlumbBob;
  model.width_px = lens.width_px;
  model.height_px = lens.height_px;
  model.parameters.resize(9);
  model.parameters << lens.fx, lens.fy, lens.cx, lens.cy, lens.k1, lens.k2, lens.p1, lens.p2, lens.k3;
  return model;
}

Pose<Base, Color> Truth::bMc(const std::string& camera) const {
  return Pose<Base, Color>(impl_->cameras.at(camera)->truth().bMc);
}

Pose<EndEffector, Board> Truth::eMo() const { return Pose<EndEffector, Board>(impl_->eMo); }

Pose<Base, EndEffector> Truth::bMe() const { return bMe(impl_->clock.now()); }

Pose<Base, EndEffector> Truth::bMe(Instant instant) const {
  return Pose<Base, EndEffector>(impl_->arm->flangeAt(instant));
}

Eigen::VectorXd Truth::q() const { return q(impl_->clock.now()); }
Eigen::VectorXd Truth::q(Instant instant) const { return impl_->arm->jointsAt(instant); }

Pose<Color, Board> Truth::cMo(const std::string& camera, Instant instant) const {
  return bMc(camera).inverse() * bMe(instant) * eMo();
}

std::vector<Eigen::Vector2d> Truth::corners(const std::string& camera, Instant instant) const {
  const Lens& lens = impl_->cameras.at(camera)->truth().lens;
  const Pose<Color, Board> pose = cMo(camera, instant);
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
