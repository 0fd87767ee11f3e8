// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/best_estimate.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "random_result.h"

namespace servocal {
namespace {

class BestEstimate : public testing::Test {
 protected:
  CalibrationResult result_ = test::RandomResult(5).make(2);
};

TEST_F(BestEstimate, IsOfOnePiece) {
  const CalibrationResult best = bestEstimate(result_);
  ASSERT_EQ(best.cameras.size(), 2u);
  for (const CameraResult& camera : best.cameras) {
    SCOPED_TRACE(camera.camera);
    const JointCameraResult &color = *result_.joint->find(camera.camera, Stream::kColor),
                            &infrared = *result_.joint->find(camera.camera, Stream::kInfrared);
    EXPECT_EQ(camera.intrinsics.camera.parameters, color.model.parameters);
    EXPECT_EQ(camera.infrared->camera.parameters, infrared.model.parameters);
    EXPECT_EQ(camera.depth->model.camera.parameters, infrared.model.parameters);
    EXPECT_EQ(camera.hand_eye->camera_pose.matrix(), color.pose.matrix());
    EXPECT_EQ(camera.hand_eye->board_pose.matrix(), result_.joint->board_pose.matrix());
    EXPECT_EQ(camera.infrared_hand_eye->camera_pose.matrix(), infrared.pose.matrix());
    EXPECT_EQ(camera.hand_eye->camera_sigma[1], std::sqrt(color.pose_covariance(1, 1)));
    EXPECT_TRUE(camera.intrinsics.views.empty());
    EXPECT_FALSE(camera.intrinsics_with_outliers || camera.hand_eye_with_outliers);
  }
  for (const JointPair& pair : result_.joint->pairs) {
    const CameraPair& taken = pair.first == pair.second
                                  ? *best.cameras[pair.first == "cam1" ? 0 : 1].color_infrared
                                  : best.camera_pairs.front();
    EXPECT_EQ(taken.first_by_second.matrix(), pair.first_by_second.matrix());
    EXPECT_EQ(taken.covariance, pair.covariance);
  }
}

TEST_F(BestEstimate, LeavesWhatTheJointEstimateDoesNotHave) {
  const CameraResult second = result_.cameras[1];
  auto& streams = result_.joint->cameras;
  streams.erase(streams.begin() + 2, streams.end());
  auto& pairs = result_.joint->pairs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(), [](const JointPair& pair) { return pair.second == "cam2"; }),
              pairs.end());
  const CalibrationResult best = bestEstimate(result_);
  EXPECT_EQ(best.cameras[1].intrinsics.camera.parameters, second.intrinsics.camera.parameters);
  EXPECT_EQ(best.cameras[1].hand_eye->camera_pose.matrix(), second.hand_eye->camera_pose.matrix());
  EXPECT_EQ(best.cameras[1].color_infrared->first_by_second.matrix(), second.color_infrared->first_by_second.matrix());
  EXPECT_EQ(best.camera_pairs[0].first_by_second.matrix(), result_.camera_pairs[0].first_by_second.matrix());

  const CameraResult first = result_.cameras[0];
  result_.joint.reset();
  const CalibrationResult staged = bestEstimate(result_);
  EXPECT_EQ(staged.cameras[0].intrinsics.camera.parameters, first.intrinsics.camera.parameters);
  EXPECT_EQ(staged.cameras[0].intrinsics.views.size(), first.intrinsics.views.size());
}

}  // namespace
}  // namespace servocal
