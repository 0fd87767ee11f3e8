// SPDX-License-Identifier: GPL-3.0-or-later
// The numbers behind the report's plots, against a cell whose truth is known.
#include "servocal/report/report.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <nlohmann/json.hpp>
#include <random>

#include "errors.h"
#include "evidence.h"
#include "next_steps.h"
#include "recorded_cell.h"

namespace servocal::report {
namespace {

using test::expectPart;

ReportInput inputOf(const test::RecordedCell& cell) {
  ReportInput input;
  input.source = "runs/first";
  input.result = cell.result;
  input.observations = cell.observations;
  input.attempts = cell.attempts;
  input.cell_text = cell.cellText();
  return input;
}

class Report : public ::testing::Test {
 protected:
  const test::RecordedCell cell_{2, 60};
  ReportInput input_ = inputOf(cell_);
};

TEST_F(Report, ResidualsAreTheDetectorsNoise) {
  const CameraResult& camera = input_.result.cameras[0];
  const auto residuals = cornerResiduals(input_, "cam1", Stream::kColor, camera.intrinsics);
  ASSERT_GT(residuals.size(), 400u);
  double squares_px2 = 0.0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const CornerResidual& corner : residuals) {
    squares_px2 += corner.residual.squaredNorm() / static_cast<double>(residuals.size());
    mean += corner.residual / static_cast<double>(residuals.size());
    EXPECT_NE(corner.view % 23, 0) << "a view that was left out";
  }
  // 0.12 px per axis, less the six of the 48 numbers that each view's pose takes up.
  EXPECT_NEAR(std::sqrt(squares_px2), 0.12 * std::sqrt(2.0) * std::sqrt(42.0 / 48.0), 0.01);
  EXPECT_LT(mean.norm(), 0.02);
  // A lens that is wrong shows.
  IntrinsicsResult wrong = camera.intrinsics;
  wrong.camera.parameters[4] += 0.02;
  double wrong_px2 = 0.0;
  for (const CornerResidual& corner : cornerResiduals(input_, "cam1", Stream::kColor, wrong)) {
    wrong_px2 += corner.residual.squaredNorm() / static_cast<double>(residuals.size());
  }
  EXPECT_GT(wrong_px2, 1.3 * squares_px2);
}

// The uncertainty map against the spread of lenses drawn from the covariance, each turned to fit the mean
// one.
TEST_F(Report, ProjectionSigmaIsTheSpreadOfDrawnLenses) {
  IntrinsicsResult intrinsics = test::RandomResult(4).intrinsics(LensModel::kPlumbBob, 1920, 1080, 1066);
  const Eigen::VectorXd scale =
      (Eigen::VectorXd(9) << 0.3, 0.3, 0.5, 0.5, 1e-3, 3e-3, 1e-4, 1e-4, 3e-3).finished() / 0.3;
  intrinsics.covariance = scale.asDiagonal() * intrinsics.covariance * scale.asDiagonal();
  const std::vector<PixelSigma> map = projectionSigma(intrinsics, 9, 7);
  ASSERT_EQ(map.size(), 63u);
  const Eigen::MatrixXd root = Eigen::LLT<Eigen::MatrixXd>(intrinsics.covariance).matrixL();
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  std::vector<double> squares_px2(map.size(), 0.0);
  constexpr int kDraws = 2000;
  for (int draw = 0; draw < kDraws; ++draw) {
    CameraModel lens = intrinsics.camera;
    Eigen::VectorXd unit(9);
    for (double& entry : unit) entry = normal(random);
    lens.parameters += root * unit;
    // Where the drawn lens puts the rays, and the small turn that brings that nearest to the mean lens.
    Eigen::MatrixXd by_turn(2 * map.size(), 3);
    Eigen::VectorXd shift(2 * map.size());
    for (std::size_t i = 0; i < map.size(); ++i) {
      const Eigen::Vector3d ray = intrinsics.camera.unproject(map[i].pixel)->homogeneous();
      const auto row = static_cast<Eigen::Index>(2 * i);
      shift.segment<2>(row) = lens.project(ray).value() - map[i].pixel;
      for (int axis = 0; axis < 3; ++axis) {
        const Eigen::Vector3d turned = Eigen::AngleAxisd(1e-6, Eigen::Vector3d::Unit(axis)) * ray;
        by_turn.block<2, 1>(row, axis) = (intrinsics.camera.project(turned).value() - map[i].pixel) / 1e-6;
      }
    }
    const Eigen::VectorXd left = shift - by_turn * by_turn.colPivHouseholderQr().solve(shift);
    for (std::size_t i = 0; i < map.size(); ++i) {
      squares_px2[i] += 0.5 * left.segment<2>(static_cast<Eigen::Index>(2 * i)).squaredNorm() / kDraws;
    }
  }
  for (std::size_t i = 0; i < map.size(); ++i) {
    EXPECT_NEAR(map[i].sigma_px / std::sqrt(squares_px2[i]), 1.0, 0.08) << map[i].pixel.transpose();
  }
  intrinsics.covariance.resize(0, 0);
  EXPECT_TRUE(projectionSigma(intrinsics, 9, 7).empty());
}

TEST_F(Report, HandEyeStepsApproachTheAnswer) {
  const std::vector<HandEyeStep> steps = handEyeSteps(input_, input_.result.cameras[0]);
  ASSERT_GT(steps.size(), 4u);
  EXPECT_EQ(steps.front().views, 4);
  EXPECT_GT(steps.front().sigma_m, steps.back().sigma_m);
  EXPECT_LT(steps.back().error_m, 4 * steps.back().sigma_m);  // the result is the truth here
  EXPECT_LT(steps.back().error_m, 0.001);
}

TEST_F(Report, DepthSamplesShowWhatTheCorrectionDoes) {
  for (const CameraResult& camera : input_.result.cameras) {
    const std::vector<DepthSample> samples = depthSamples(input_, camera);
    ASSERT_GT(samples.size(), 300u) << camera.camera;
    double before_m2 = 0.0, after_m2 = 0.0;
    for (const DepthSample& at : samples) {
      before_m2 += at.before_m * at.before_m / static_cast<double>(samples.size());
      after_m2 += at.after_m * at.after_m / static_cast<double>(samples.size());
    }
    EXPECT_LT(std::sqrt(after_m2), 0.002) << camera.camera;  // 1 mm of noise, and the corners' own
    EXPECT_GT(std::sqrt(before_m2), 2 * std::sqrt(after_m2)) << camera.camera;
  }
}

TEST_F(Report, BoardsStandWhereTheArmHeldThem) {
  const CameraResult& camera = input_.result.cameras[0];
  const std::vector<VisitedPose> visited = visitedPoses(input_, camera);
  ASSERT_EQ(visited.size(), input_.observations.size());
  // The first stops were held before this camera, 0.4 to 0.7 m away.
  const Eigen::Vector3d in_camera =
      camera.hand_eye->camera_pose.inverse() * visited[0].base_by_moving.translation();
  EXPECT_GT(in_camera.z(), 0.4);
  EXPECT_LT(in_camera.z(), 0.7);
}

TEST_F(Report, NextStepsFollowFromTheResult) {
  const auto has = [&](const std::string& part) {
    for (const std::string& step : nextSteps(input_.result)) {
      if (step.find(part) != std::string::npos) return true;
    }
    return false;
  };
  CameraResult& camera = input_.result.cameras[0];
  EXPECT_TRUE(has("servocal-export"));
  EXPECT_FALSE(has("Measure the board") || has("Take more views") || has("latency_s") ||
               has("Still missing"));
  camera.board_scale = BoardScale{1.01, 1e-4};
  EXPECT_TRUE(has("seen from cam1, it is 1 % larger than the cell file says"));
  camera.hand_eye->camera_sigma[0] = 0.003;
  EXPECT_TRUE(has("Take more views of cam1"));
  camera.hand_eye->scatter_m = 0.004;
  EXPECT_TRUE(has("the board moves on the flange by 4 mm RMS"));
  camera.time_offset_s = -0.03;
  EXPECT_TRUE(has("its images are stamped 30 ms too early"));
  for (int i = 0; i < 5; ++i) {
    camera.intrinsics.views[static_cast<std::size_t>(i)].used = false;
    camera.intrinsics.views[static_cast<std::size_t>(i)].cause = ViewCause::kRobotPose;
  }
  EXPECT_TRUE(has("Check the arm's clock"));
  input_.result.goal_met = false;
  input_.result.missing = {"cam1: no far view"};
  EXPECT_EQ(nextSteps(input_.result)[0], "Still missing: cam1: no far view.");
  EXPECT_TRUE(has("Do not use this result before"));
  EXPECT_FALSE(has("servocal-export"));
}

TEST_F(Report, JsonHoldsEveryPlotsNumbers) {
  const auto tree = nlohmann::json::parse(reportJson(input_));
  EXPECT_EQ(tree["verdict"]["goal_met"], true);
  ASSERT_EQ(tree["cameras"].size(), 2u);
  for (const auto& camera : tree["cameras"]) {
    ASSERT_EQ(camera["streams"].size(), 2u);
    for (const auto& stream : camera["streams"]) {
      EXPECT_EQ(stream["coverage"]["cells"].size(), 40u);
      EXPECT_EQ(stream["tilt_limits"].size(), 6u);
      EXPECT_EQ(stream["uncertainty"].size(), 25u * 17u);
      EXPECT_EQ(stream["residuals"]["u"].size(), stream["residuals"]["dv"].size());
      EXPECT_GT(stream["residuals"]["u"].size(), 300u);
    }
    EXPECT_GT(camera["depth"]["samples"].size(), 300u);
    EXPECT_GT(camera["hand_eye"]["steps"].size(), 3u);
    EXPECT_EQ(camera["hand_eye"]["camera"]["parent"], "base");
  }
  EXPECT_EQ(tree["scene"]["cameras"].size(), 4u);
  EXPECT_EQ(tree["scene"]["moving"].size(), 60u);
  EXPECT_EQ(tree["timeline"]["drives"].size(), 60u);
  EXPECT_EQ(tree["provenance"]["cell_file"], input_.cell_text);
  // A result alone has less to show, and shows it.
  input_.observations.clear();
  input_.attempts.clear();
  const auto alone = nlohmann::json::parse(reportJson(input_));
  EXPECT_EQ(alone["cameras"][0]["streams"][0]["residuals"]["u"].size(), 0u);
  EXPECT_EQ(alone["cameras"][0]["streams"][0]["uncertainty"].size(), 25u * 17u);
  EXPECT_EQ(alone["scene"]["moving"].size(), 0u);
}

}  // namespace
}  // namespace servocal::report
