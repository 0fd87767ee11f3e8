// SPDX-License-Identifier: GPL-3.0-or-later
// What the report draws beyond the result's own numbers: the arm, depth on color, the joint estimate.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "arm_skeleton.h"
#include "evidence.h"
#include "recorded_cell.h"
#include "servocal/report/report.h"

namespace servocal::report {
namespace {

Observation stopAt(std::int64_t id, const Eigen::VectorXd& q) {
  Observation observation;
  observation.id = id;
  observation.robot.emplace();
  observation.robot->q = q;
  return observation;
}

// A UR5 stretched out: its published lengths, from the base to the flange.
TEST(ArmLines, FollowTheLinksOfAUr5) {
  ReportInput input;
  input.cell_text = test::RecordedCell::cellText();
  Eigen::VectorXd bent = Eigen::VectorXd::Zero(6), same = bent;
  bent[1] = -1.2;
  same[0] = 0.1;
  input.observations = {stopAt(1, Eigen::VectorXd::Zero(6)), stopAt(2, same), stopAt(3, bent)};
  const std::vector<ArmLine> lines = armLines(input, 6);
  ASSERT_EQ(lines.size(), 2u) << "stops that look alike are drawn once";
  for (const ArmLine& line : lines) {
    double longest = 0.0, second = 0.0;
    for (std::size_t i = 1; i < line.size(); ++i) {
      const double length = (line[i] - line[i - 1]).norm();
      if (length > longest) second = std::exchange(longest, length);
      else second = std::max(second, length);
    }
    EXPECT_LT(line.front().norm(), 1e-12);
    EXPECT_NEAR(longest, 0.425, 0.001);
    EXPECT_NEAR(second, 0.3923, 0.001);
  }
  EXPECT_LT((lines[0].back() - Eigen::Vector3d(-0.8173, -0.1915, -0.0055)).norm(), 0.001);
  EXPECT_EQ(armLines(input, 1).size(), 1u);
  input.cell_text.clear();
  EXPECT_TRUE(armLines(input, 6).empty());
}

// Points seen without noise by both lenses: the result puts depth where color sees it, the data sheets do not.
TEST(Overlay, IsExactByTheResultAndOffByTheDataSheets) {
  const test::RecordedCell cell(1, 12);
  ReportInput input;
  input.cell_text = test::RecordedCell::cellText();
  CameraResult camera = cell.result.cameras[0];
  camera.camera = "left";
  Observation observation;
  observation.id = 7;
  StreamObservation color, infrared;
  color.camera = infrared.camera = "left";
  infrared.stream = Stream::kInfrared;
  infrared.depth.emplace();
  for (int id = 0; id < 12; ++id) {
    const Eigen::Vector3d point_i(0.05 * (id % 4) - 0.08, 0.05 * (id / 4) - 0.05, 0.6 + 0.01 * id);
    const Eigen::Vector2d pixel = camera.infrared->camera.project(point_i).value();
    double raw_m = point_i.z();
    for (int i = 0; i < 30; ++i) raw_m += point_i.z() - camera.depth->model.correct(pixel, raw_m).value();
    infrared.detection.corners.push_back({id, pixel, Eigen::Matrix2d::Identity()});
    infrared.depth->corners.push_back({id, raw_m, 9});
    const Eigen::Vector3d point_c = camera.color_infrared->first_by_second * point_i;
    if (id != 5)
      color.detection.corners.push_back(
          {id, camera.intrinsics.camera.project(point_c).value(), Eigen::Matrix2d::Identity()});
  }
  observation.views = {color, infrared};
  input.observations = {observation};
  const std::vector<OverlayCorner> overlay = overlayCorners(input, camera);
  ASSERT_EQ(overlay.size(), 11u) << "a corner that color does not see has no place";
  for (const OverlayCorner& corner : overlay) {
    ASSERT_TRUE(corner.before && corner.after);
    EXPECT_EQ(corner.view, 7);
    EXPECT_LT((*corner.after - corner.color).norm(), 1e-6);
    EXPECT_GT((*corner.before - corner.color).norm(), 5.0);
  }
  camera.camera = "nobody";
  EXPECT_TRUE(overlayCorners(input, camera).empty());
}

TEST(JointReport, ShowsWhatTheJointEstimateSays) {
  const test::RecordedCell cell(1, 12);
  ReportInput input;
  input.result = cell.result;
  EXPECT_FALSE(nlohmann::json::parse(reportJson(input)).contains("joint"));
  JointResult joint;
  joint.model = "one board";
  joint.faults = {"nobody"};
  joint.held_out = JointHeldOut{3, 0.2, 0.0004, 1.1};
  JointCameraResult camera;
  camera.camera = "cam1";
  camera.model = cell.result.cameras[0].intrinsics.camera;
  camera.pose_covariance.setZero();
  camera.pose_covariance(0, 0) = 9e-8;
  camera.pose_covariance(1, 1) = 16e-8;
  camera.at_range = {2, 1, {0.25, std::numeric_limits<double>::quiet_NaN()}, 0.25, 0.2};
  joint.cameras = {camera};
  input.result.joint = joint;
  const auto tree = nlohmann::json::parse(reportJson(input))["joint"];
  EXPECT_EQ(tree["cameras"][0]["place_sigma_mm"], 0.5);
  EXPECT_EQ(tree["cameras"][0]["at_range"]["sigma_px"][0], 0.25);
  EXPECT_EQ(tree["cameras"][0]["at_range"]["sigma_px"][1], nullptr);
  EXPECT_EQ(tree["held_out"]["rms_mm"], 0.4);
  EXPECT_EQ(tree["faults"][0], "nobody");
}

}  // namespace
}  // namespace servocal::report
