// SPDX-License-Identifier: GPL-3.0-or-later
// Numbers that are none, in one corner of one view or in all of a camera: an estimator leaves the view out,
// refuses, or says that it did not converge; it never hands out a solution that holds one, and it ends.
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <stdexcept>

#include "joint_scene.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/calib/reprojection.h"

namespace servocal::calib {
namespace {

using Spoil = std::function<void(Corner&)>;

struct Case {
  const char* name;
  Spoil spoil;
};

constexpr double kNan = std::numeric_limits<double>::quiet_NaN(),
                 kInf = std::numeric_limits<double>::infinity();

const Case kCases[] = {
    {"pixel not a number", [](Corner& corner) { corner.pixel.x() = kNan; }},
    {"pixel infinite", [](Corner& corner) { corner.pixel.y() = kInf; }},
    {"covariance not a number", [](Corner& corner) { corner.covariance_px2.setConstant(kNan); }},
    {"covariance zero", [](Corner& corner) { corner.covariance_px2.setZero(); }},
    {"covariance negative", [](Corner& corner) { corner.covariance_px2 = -Eigen::Matrix2d::Identity(); }},
    {"covariance infinite", [](Corner& corner) { corner.covariance_px2.setConstant(kInf); }}};

class NotANumber : public ::testing::Test {
 protected:
  NotANumber() {
    std::mt19937_64 random(3);
    cell = test::makeCell(3, 1, Mount::kFixed, false);
    sound = test::observeAll(cell, test::randomStops(cell, 15, random), {0.1, 1e-4, 2.5e-4}, random);
  }

  /// One corner of the third view spoiled, or all corners of all views.
  std::vector<Observation> spoiled(const Spoil& spoil, bool everywhere) const {
    std::vector<Observation> observations = sound;
    if (!everywhere) spoil(observations[2].views[0].detection.corners[7]);
    for (Observation& observation : observations) {
      for (StreamObservation& view : observation.views) {
        for (Corner& corner : view.detection.corners) {
          if (everywhere) spoil(corner);
        }
      }
    }
    return observations;
  }

  void forAll(const std::function<void(const std::vector<Observation>&)>& solve) const {
    for (const Case& one : kCases) {
      for (const bool everywhere : {false, true}) {
        SCOPED_TRACE(std::string(one.name) + (everywhere ? ", everywhere" : ", once"));
        try {
          solve(spoiled(one.spoil, everywhere));
        } catch (const std::invalid_argument&) {  // A refusal.
        }
      }
    }
  }

  test::Cell cell;
  std::vector<Observation> sound;
};

TEST_F(NotANumber, IsInNoIntrinsics) {
  ASSERT_TRUE(solveIntrinsics(cell.board, sound, "k1", Stream::kColor).result);
  forAll([&](const std::vector<Observation>& observations) {
    const IntrinsicsOutcome outcome = solveIntrinsics(cell.board, observations, "k1", Stream::kColor);
    if (!outcome.result) return;
    EXPECT_TRUE(outcome.result->camera.parameters.allFinite());
    EXPECT_TRUE(outcome.result->covariance.allFinite());
    EXPECT_NEAR(outcome.result->camera.fx(), cell.cameras[0].model.fx(), 20.0);
  });
}

TEST_F(NotANumber, IsInNoHandEye) {
  const CameraModel& model = cell.cameras[0].model;
  ASSERT_TRUE(solveHandEyeReprojection(cell.board, model, sound, "k1", Stream::kColor).solution);
  forAll([&](const std::vector<Observation>& observations) {
    const auto outcome = solveHandEyeReprojection(cell.board, model, observations, "k1", Stream::kColor);
    if (!outcome.solution) return;
    EXPECT_TRUE(outcome.solution->camera_pose.matrix().allFinite());
    EXPECT_TRUE(outcome.solution->camera_sigma.allFinite());
    EXPECT_LT((outcome.solution->camera_pose.translation() - cell.cameras[0].pose.translation()).norm(),
              0.005);
  });
}

TEST_F(NotANumber, IsInNoJointEstimate) {
  ASSERT_TRUE(solveJoint(cell.board, sound).solution);
  forAll([&](const std::vector<Observation>& observations) {
    const JointOutcome outcome = solveJoint(cell.board, observations);
    if (!outcome.solution) return;
    EXPECT_TRUE(outcome.solution->board_pose.matrix().allFinite());
    EXPECT_TRUE(outcome.solution->cameras[0].model.parameters.allFinite());
    EXPECT_LT((outcome.solution->cameras[0].pose.translation() - cell.cameras[0].pose.translation()).norm(),
              0.005);
  });
}

}  // namespace
}  // namespace servocal::calib
