// SPDX-License-Identifier: GPL-3.0-or-later
#include "result_parts.h"

#include <cmath>

namespace servocal::session {
namespace {

bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

}  // namespace

double radians(double deg) {
  const double quotient = deg / kDegPerRad;
  double below = quotient, above = quotient;
  for (int step = 0; step < 3; ++step) {
    if (below * kDegPerRad == deg) return below;
    if (above * kDegPerRad == deg) return above;
    below = std::nextafter(below, -INFINITY);
    above = std::nextafter(above, INFINITY);
  }
  return quotient;
}

Eigen::VectorXd vectorOf(const ConfigReader& tree, const char* key, std::size_t size) {
  const std::vector<double> values = tree.numbers(key, size, kNumber);
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

ReadModel readModel(const ConfigReader& tree, bool with_sigma) {
  ReadModel read;
  CameraModel& camera = read.camera;
  const std::vector<LensModel> lenses = {LensModel::kPlumbBob, LensModel::kRational};
  camera.lens = lenses[tree.choice("lens_model", {toString(lenses[0]), toString(lenses[1])})];
  camera.width_px = tree.integer("width_px", {1, 1000000});
  camera.height_px = tree.integer("height_px", {1, 1000000});
  const std::vector<std::string>& names = parameterNames(camera.lens);
  camera.parameters.resize(static_cast<Eigen::Index>(names.size()));
  if (with_sigma) read.sigma.resize(camera.parameters.size());
  const ConfigReader parameters = tree.section("parameters");
  // All asked for before any is demanded: a missing p1 is not a misspelled p2.
  for (const std::string& name : names) parameters.has(withUnit(name));
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto index = static_cast<Eigen::Index>(i);
    const ConfigReader entry = parameters.section(withUnit(names[i]));
    camera.parameters[index] = entry.number("value", {});
    if (with_sigma) read.sigma[index] = entry.number("sigma", kNumber);
    entry.finish();
  }
  parameters.finish();
  const Eigen::Matrix3d k = tree.matrix("camera_matrix_px", 3, 3, {});
  if (k(0, 0) != camera.fx() || k(1, 1) != camera.fy() || k(0, 2) != camera.cx() || k(1, 2) != camera.cy()) {
    tree.fail("camera_matrix_px", "'camera_matrix_px' contradicts 'parameters'");
  }
  const Eigen::Index coefficients = camera.parameters.size() - 4;
  const Eigen::VectorXd d = vectorOf(tree, "distortion_coefficients", static_cast<std::size_t>(coefficients));
  if (d != camera.parameters.tail(coefficients)) {
    tree.fail("distortion_coefficients", "'distortion_coefficients' contradicts 'parameters'");
  }
  return read;
}

ReadPose readPose(const ConfigReader& tree, const PoseNames& names) {
  const std::pair<const char*, std::string> expected[] = {
      {"name", names.name}, {"parent_frame", names.parent}, {"child_frame", names.child}};
  for (const auto& [key, value] : expected) tree.choice(key, {value});
  ReadPose read;
  read.pose.matrix() = tree.matrix("matrix", 4, 4, kNumber);
  const Eigen::VectorXd translation = vectorOf(tree, "translation_m", 3);
  for (int i = 0; i < 3; ++i) {
    if (!same(translation[i], read.pose.translation()[i]))
      tree.fail("matrix", "'matrix' contradicts 'translation_m'");
  }
  const Eigen::Vector4d q = vectorOf(tree, "quaternion_xyzw", 4);
  if (read.pose.matrix().allFinite()) {
    const Eigen::Matrix3d rotation = Eigen::Quaterniond(q).toRotationMatrix();
    if (!((rotation - read.pose.linear()).norm() < 1e-9))
      tree.fail("matrix", "'matrix' contradicts 'quaternion_xyzw'");
  }
  read.sigma.head<3>() = vectorOf(tree, "translation_sigma_m", 3);
  read.sigma.tail<3>() = vectorOf(tree, "rotation_sigma_deg", 3).unaryExpr(&radians);
  tree.finish();
  return read;
}

}  // namespace servocal::session
