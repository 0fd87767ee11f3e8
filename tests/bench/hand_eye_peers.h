// SPDX-License-Identifier: GPL-3.0-or-later
// Other programs' hand-eye solvers, all with the same arguments.
#pragma once

#include <visp3/vision/vpHandEyeCalibration.h>

#include <iostream>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <vector>

#include "servocal/core/pose.h"

namespace servocal::test {

struct Stops {
  std::vector<Pose<Base, EndEffector>> lMr;  // bMe, or its inverse for a camera on the flange
  std::vector<Pose<Color, Board>> cMo;       // best planar solution
};

inline cv::Mat matOf(const Eigen::Matrix3d& m) {
  cv::Mat out(3, 3, CV_64F);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out.at<double>(r, c) = m(r, c);
  }
  return out;
}
inline cv::Mat matOf(const Eigen::Vector3d& v) { return (cv::Mat_<double>(3, 1) << v.x(), v.y(), v.z()); }

inline Eigen::Isometry3d isometryOf(const cv::Mat& rotation, const cv::Mat& translation) {
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out(r, c) = rotation.at<double>(r, c);
    out(r, 3) = translation.at<double>(r);
  }
  return out;
}

inline Eigen::Isometry3d opencvHandEye(const Stops& stops, cv::HandEyeCalibrationMethod method) {
  std::vector<cv::Mat> r_gripper, t_gripper, r_target, t_target;
  for (std::size_t i = 0; i < stops.lMr.size(); ++i) {
    const auto rMl = stops.lMr[i].inverse();  // OpenCV solves for a camera that moves with its "gripper"
    r_gripper.push_back(matOf(rMl.rotation()));
    t_gripper.push_back(matOf(rMl.translation()));
    r_target.push_back(matOf(stops.cMo[i].rotation()));
    t_target.push_back(matOf(stops.cMo[i].translation()));
  }
  cv::Mat rotation, translation;
  cv::calibrateHandEye(r_gripper, t_gripper, r_target, t_target, rotation, translation, method);
  return isometryOf(rotation, translation);
}

inline Eigen::Isometry3d opencvRobotWorld(const Stops& stops, cv::RobotWorldHandEyeCalibrationMethod method) {
  // World = board, gripper frame = l: camera from board, l from r.
  std::vector<cv::Mat> r_world, t_world, r_base, t_base;
  for (std::size_t i = 0; i < stops.lMr.size(); ++i) {
    r_world.push_back(matOf(stops.cMo[i].rotation()));
    t_world.push_back(matOf(stops.cMo[i].translation()));
    r_base.push_back(matOf(stops.lMr[i].rotation()));
    t_base.push_back(matOf(stops.lMr[i].translation()));
  }
  cv::Mat r_base_world, t_base_world, r_gripper_cam, t_gripper_cam;
  cv::calibrateRobotWorldHandEye(r_world, t_world, r_base, t_base, r_base_world, t_base_world, r_gripper_cam,
                                 t_gripper_cam, method);
  return isometryOf(r_gripper_cam, t_gripper_cam).inverse();
}

inline vpHomogeneousMatrix vispOf(const Eigen::Isometry3d& pose) {
  vpHomogeneousMatrix out;
  for (unsigned r = 0; r < 3; ++r) {
    for (unsigned c = 0; c < 4; ++c) out[r][c] = pose(r, c);
  }
  return out;
}

/// ViSP prints what it finds.
class Muted {
 public:
  Muted() : stdout_(std::cout.rdbuf(nullptr)) {}
  ~Muted() { std::cout.rdbuf(stdout_); }
  Muted(const Muted&) = delete;
  Muted& operator=(const Muted&) = delete;

 private:
  std::streambuf* stdout_;
};

/// Nothing if ViSP says that it failed.
inline std::optional<Eigen::Isometry3d> vispHandEye(const Stops& stops) {
  std::vector<vpHomogeneousMatrix> cMo, rMl;
  for (std::size_t i = 0; i < stops.lMr.size(); ++i) {
    cMo.push_back(vispOf(stops.cMo[i].isometry()));
    rMl.push_back(vispOf(stops.lMr[i].inverse().isometry()));  // ViSP too solves for a camera that moves
  }
  vpHomogeneousMatrix lMc;
  const Muted muted;
  if (vpHandEyeCalibration::calibrate(cMo, rMl, lMc) != 0) return std::nullopt;
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  for (unsigned r = 0; r < 3; ++r) {
    for (unsigned c = 0; c < 4; ++c) out(r, c) = lMc[r][c];
  }
  return out;
}

}  // namespace servocal::test
