// SPDX-License-Identifier: GPL-3.0-or-later
// Sessions full of random numbers, and programs that die while they write one.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>
#include <opencv2/core.hpp>
#include <random>

#include "poses.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/observation.h"

namespace servocal::test {

inline BoardSpec oddBoard() {
  BoardSpec board;
  std::get<Checkerboard>(board.pattern).square_size_m = 0.1 / 3.0;
  board.margin_m = 1.0 / 70.0;
  return board;
}

inline cv::Mat noiseImage(std::uint64_t seed) {
  cv::Mat image(48, 64, CV_8UC1);
  cv::RNG random(seed);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

inline Observation randomObservation(std::mt19937_64& random, bool with_robot) {
  std::normal_distribution<double> normal;
  Observation observation;
  observation.stage = "cover";
  if (with_robot) {
    RobotState robot;
    robot.stamp = Instant(Duration(1234567890123 + static_cast<std::int64_t>(random() % 1000)));
    robot.device_stamp_s = normal(random);
    robot.q = Eigen::VectorXd::NullaryExpr(6, [&] { return normal(random); });
    robot.bMe = randomPose<Base, EndEffector>(random, 3.0, 1.0);
    robot.twist = {Eigen::Vector3d(normal(random), 1e-17, -1.0 / 3.0), Eigen::Vector3d(0, normal(random), 1)};
    observation.robot = robot;
  }
  for (const char* camera : {"cam1", "left/odd name"}) {
    StreamObservation view;
    view.camera = camera;
    view.stream = camera[0] == 'c' ? Stream::kColor : Stream::kInfrared;
    view.stamp = Instant(Duration(77));
    view.device_stamp_s = 1.0 / 7.0;
    view.width_px = 64;
    view.height_px = 48;
    view.detection.orientation_known = camera[0] == 'c';
    for (int id = 0; id < 24; ++id) {
      Corner corner;
      corner.id = id;
      corner.pixel = {normal(random) * 100, normal(random) * 100};
      corner.covariance_px2 << 0.01 / 3, normal(random), 0, 0.02 / 7;
      corner.covariance_px2(1, 0) = corner.covariance_px2(0, 1);
      view.detection.corners.push_back(corner);
    }
    if (view.stream == Stream::kInfrared) {
      BoardDepth depth;
      for (int id = 0; id < 24; id += 2) depth.corners.push_back({id, 0.7 + normal(random), 100 + id});
      for (int i = 0; i < 9; ++i) {
        depth.patches.push_back({{normal(random), normal(random)}, 0.8 + normal(random), 1e-3 / 3.0, 40 + i});
      }
      depth.plane_rms_m = 0.0015;
      depth.valid_share = 0.97;
      depth.frames = 5;
      view.depth = depth;
    }
    observation.views.push_back(view);
  }
  return observation;
}

inline void expectSame(const BoardDepth& a, const BoardDepth& b) {
  EXPECT_EQ(a.plane_rms_m, b.plane_rms_m);
  EXPECT_EQ(a.valid_share, b.valid_share);
  EXPECT_EQ(a.frames, b.frames);
  EXPECT_EQ(a.image_file, b.image_file);
  ASSERT_EQ(a.corners.size(), b.corners.size());
  for (std::size_t k = 0; k < a.corners.size(); ++k) {
    EXPECT_EQ(a.corners[k].id, b.corners[k].id);
    EXPECT_EQ(a.corners[k].depth_m, b.corners[k].depth_m);
    EXPECT_EQ(a.corners[k].pixels, b.corners[k].pixels);
  }
  ASSERT_EQ(a.patches.size(), b.patches.size());
  for (std::size_t k = 0; k < a.patches.size(); ++k) {
    EXPECT_EQ(a.patches[k].pixel, b.patches[k].pixel);
    EXPECT_EQ(a.patches[k].depth_m, b.patches[k].depth_m);
    EXPECT_EQ(a.patches[k].sigma_m, b.patches[k].sigma_m);
    EXPECT_EQ(a.patches[k].pixels, b.patches[k].pixels);
  }
}

inline void expectSame(const Observation& a, const Observation& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.stage, b.stage);
  ASSERT_EQ(a.robot.has_value(), b.robot.has_value());
  if (a.robot) {
    EXPECT_EQ(a.robot->stamp, b.robot->stamp);
    EXPECT_EQ(a.robot->device_stamp_s, b.robot->device_stamp_s);
    EXPECT_EQ(a.robot->q, b.robot->q);
    EXPECT_EQ(a.robot->bMe.isometry().matrix(), b.robot->bMe.isometry().matrix());
    EXPECT_EQ(a.robot->twist.linear_mps, b.robot->twist.linear_mps);
    EXPECT_EQ(a.robot->twist.angular_radps, b.robot->twist.angular_radps);
  }
  ASSERT_EQ(a.views.size(), b.views.size());
  for (std::size_t i = 0; i < a.views.size(); ++i) {
    const StreamObservation &va = a.views[i], &vb = b.views[i];
    EXPECT_EQ(va.camera, vb.camera);
    EXPECT_EQ(va.stream, vb.stream);
    EXPECT_EQ(va.stamp, vb.stamp);
    EXPECT_EQ(va.device_stamp_s, vb.device_stamp_s);
    EXPECT_EQ(va.width_px, vb.width_px);
    EXPECT_EQ(va.height_px, vb.height_px);
    EXPECT_EQ(va.image_file, vb.image_file);
    EXPECT_EQ(va.detection.orientation_known, vb.detection.orientation_known);
    ASSERT_EQ(va.depth.has_value(), vb.depth.has_value());
    if (va.depth) expectSame(*va.depth, *vb.depth);
    ASSERT_EQ(va.detection.corners.size(), vb.detection.corners.size());
    for (std::size_t k = 0; k < va.detection.corners.size(); ++k) {
      EXPECT_EQ(va.detection.corners[k].id, vb.detection.corners[k].id);
      EXPECT_EQ(va.detection.corners[k].pixel, vb.detection.corners[k].pixel);
      EXPECT_EQ(va.detection.corners[k].covariance_px2, vb.detection.corners[k].covariance_px2);
    }
  }
}

/// Runs `body` in a child process and returns how it ended; 42 is a normal end of the body.
inline int statusOfChild(const std::function<void()>& body) {
  const pid_t child = fork();
  if (child == 0) {
    try {
      body();
    } catch (const std::exception& error) {
      std::fprintf(stderr, "child: %s\n", error.what());
      _exit(1);
    }
    _exit(42);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return status;
}

}  // namespace servocal::test
