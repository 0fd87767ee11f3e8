// SPDX-License-Identifier: GPL-3.0-or-later
#include "goals.h"

#include <gtest/gtest.h>

#include <cmath>

namespace servocal::procedure {
namespace {

bool names(const std::vector<std::string>& missed, const std::string& part) {
  for (const std::string& sentence : missed) {
    if (sentence.find(part) != std::string::npos) return true;
  }
  return false;
}

JointResult known(double projection_px, double point_m) {
  JointResult joint;
  joint.cameras.resize(2);
  for (JointCameraResult& camera : joint.cameras) {
    camera.camera = "left";
    camera.at_range.worst_px = 0.1;
    camera.at_infinity.worst_px = 0.1;
    camera.workspace.worst_m = 0.0001;
  }
  joint.cameras[1].stream = Stream::kInfrared;
  joint.cameras[1].at_infinity.worst_px = projection_px;
  joint.cameras[1].workspace.worst_m = point_m;
  return joint;
}

TEST(Goals, AreMissedByTheStreamAndTheQuantityThatMissThem) {
  const PlannerConfig goals;
  EXPECT_TRUE(goalsMissed(known(0.35, 0.0005), goals).empty());
  const auto projection = goalsMissed(known(0.36, 0.0005), goals);
  ASSERT_EQ(projection.size(), 1u);
  EXPECT_TRUE(names(projection, "left infrared") && names(projection, "0.36 px") && names(projection, "0.35 px"));
  const auto point = goalsMissed(known(0.2, 0.0007), goals);
  ASSERT_EQ(point.size(), 1u);
  EXPECT_TRUE(names(point, "0.70 mm"));
  EXPECT_EQ(goalsMissed(known(NAN, NAN), goals).size(), 2u);  // What is not known has not been reached.
}

TEST(Goals, AnEstimateThatContradictsItselfHasNotReachedThem) {
  JointResult joint = known(0.2, 0.0002);
  joint.cameras[0].halves = JointHalves{0.5, 0.2};
  joint.held_out = JointHeldOut{9, 0.1, 0.0001, 1.4};
  EXPECT_TRUE(goalsMissed(joint, {}).empty());
  joint.cameras[0].halves->rms_px = 0.7;
  EXPECT_TRUE(names(goalsMissed(joint, {}), "every other stop"));
  joint.cameras[0].halves.reset();
  joint.held_out->z = 2.5;
  EXPECT_TRUE(names(goalsMissed(joint, {}), "2.5 times"));
}

}  // namespace
}  // namespace servocal::procedure
