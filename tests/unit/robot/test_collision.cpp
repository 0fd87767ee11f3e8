// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot/collision.h"

#include <gtest/gtest.h>

#include <random>

#include "cells.h"
#include "errors.h"
#include "servocal/robot/kinematics.h"
#include "servocal/robot/path_planner.h"

namespace servocal::robot {
namespace {

const Pose<EndEffector, Board> kMount = Pose<EndEffector, Board>::fromRotationVector({0, 0, 0}, {0, 0, 0.04});

Eigen::VectorXd degrees(std::initializer_list<double> values) {
  Eigen::VectorXd q(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), q.begin());
  return q * M_PI / 180.0;
}

CollisionModel defaultModel() {
  const CellConfig cell = test::oneCameraCell();
  CollisionModel model(cell.arm, cell.limits.keep_out, cell.board);
  model.setBoard(kMount);
  return model;
}

TEST(Collision, NothingTouchesWhereTheDefaultCellStarts) {
  const CellConfig cell = test::oneCameraCell();
  const CollisionModel model = defaultModel();
  EXPECT_FALSE(model.contact(cell.arm.start_q).has_value()) << *model.contact(cell.arm.start_q);
  EXPECT_GT(model.clearance(cell.arm.start_q), 0.02);
}

TEST(Collision, NamesWhatTouches) {
  const CollisionModel model = defaultModel();
  // Folded at the elbow, upper arm up: the forearm comes down into the foot.
  const auto folded = model.contact(degrees({0, -90, 170, 0, 90, 0}));
  ASSERT_TRUE(folded);
  EXPECT_EQ(*folded, "The link 'base' would touch the link 'forearm_link'.");
  EXPECT_EQ(model.clearance(degrees({0, -90, 170, 0, 90, 0})), 0.0);
  EXPECT_THROW((void)model.contact(Eigen::VectorXd::Zero(5)), std::invalid_argument);
}

TEST(Collision, AKeepOutBoxStopsElbowAndBoardButNotTheFootThatStandsInIt) {
  const CellConfig cell = test::oneCameraCell();
  // Stretched out along x at shoulder height.
  const Eigen::VectorXd stretched = degrees({180, 0, 0, 0, 0, 0});
  const Pose<Base, EndEffector> bMe = Kinematics(cell.arm).forward(stretched);
  ASSERT_NEAR(std::abs(bMe.translation().x()), 0.817, 0.002);
  const double along = bMe.translation().x() > 0 ? 1.0 : -1.0;
  const auto boxAt = [&](double x, const char* name) {
    return Box{name, {along * x - 0.03, -0.4, 0.0}, {along * x + 0.03, 0.4, 0.3}};
  };
  const Box foot{"foot", {-0.15, -0.15, 0.0}, {0.15, 0.15, 0.3}};
  EXPECT_FALSE(CollisionModel(cell.arm, {foot}, cell.board).contact(stretched).has_value());
  const auto forearm = CollisionModel(cell.arm, {foot, boxAt(0.6, "post")}, cell.board).contact(stretched);
  ASSERT_TRUE(forearm);
  test::expectPart(*forearm, "link 'forearm_link' would touch the keep-out box 'post'");

  // Only the board is so far out.
  CollisionModel wall(cell.arm, {boxAt(0.90, "wall")}, cell.board);
  EXPECT_FALSE(wall.contact(stretched).has_value());
  wall.setBoard(kMount);
  const Eigen::Vector3d flange_z = bMe.rotation().col(2);
  EXPECT_LT(std::abs(flange_z.x()), 0.1);  // The flange looks sideways, its plate reaches forward.
  ASSERT_TRUE(wall.contact(stretched).has_value());
  test::expectPart(*wall.contact(stretched), "board");
}

// Independent of FCL: points on the forearm's tube, by robot::Kinematics of a URDF cut at the wrist, against
// the distance of a point to a box.
TEST(Collision, AgreesWithPointsOnTheForearm) {
  const CellConfig cell = test::oneCameraCell();
  ArmConfig to_forearm = cell.arm;
  to_forearm.flange_link = "forearm_link";
  const Kinematics forearm(to_forearm);
  const Box post{"post", {0.25, -0.1, 0.2}, {0.45, 0.1, 0.5}};
  // The arm without wrist and board, so that nothing but the forearm's tube and housing can touch the post
  // once the upper arm is known to be clear.
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> angle(-M_PI, M_PI);
  const CollisionModel model(to_forearm, {post}, cell.board);
  int touching = 0, clear = 0;
  for (int sample = 0; sample < 4000; ++sample) {
    Eigen::VectorXd q(3);
    for (double& value : q) value = angle(random);
    const Pose<Base, EndEffector> bMf = forearm.forward(q);
    double least = 1.0;
    const auto toPost = [&](const Eigen::Vector3d& point_f, double radius) {
      const Eigen::Vector3d point = bMf * point_f;
      const Eigen::Vector3d outside = (post.min_m - point).cwiseMax(point - post.max_m);
      least = std::min(least, outside.maxCoeff() <= 0 ? -radius : outside.cwiseMax(0.0).norm() - radius);
    };
    for (double s = 0; s <= 1.0; s += 0.005) toPost({-0.392 * s, 0, 0.016}, 0.05);
    for (double s = 0; s <= 1.0; s += 0.02) toPost({0, 0, 0.016 + 0.12 * s}, 0.06);
    const auto contact = model.contact(q);
    if (contact && contact->find("post") == std::string::npos) continue;  // The arm itself.
    if (contact && contact->find("forearm") == std::string::npos) continue;
    if (std::abs(least) < 0.002) continue;  // Points are 2 mm apart.
    EXPECT_EQ(contact.has_value(), least < 0) << q.transpose() << " " << least;
    (contact ? touching : clear) += 1;
    if (!contact) {
      EXPECT_GT(least, model.clearance(q) - 1e-4);  // FCL's own tolerance.
    }
  }
  EXPECT_GT(touching, 50);
  EXPECT_GT(clear, 500);
}

class Planning : public ::testing::Test {
 protected:
  CellConfig cell = test::oneCameraCell();
  Kinematics kinematics{cell.arm};
  Box post{"post", {0.35, -0.15, 0.0}, {0.55, 0.15, 0.7}};
  CollisionModel model{cell.arm, {post}, cell.board};
  std::function<bool(const Eigen::VectorXd&)> free = [this](const Eigen::VectorXd& q) { return !model.contact(q); };
  Eigen::VectorXd left = degrees({215, -60, 90, -30, 90, 0}), right = degrees({145, -60, 90, -30, 90, 0});

  bool freeAlong(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const {
    const int steps = static_cast<int>(std::ceil((b - a).cwiseAbs().maxCoeff() / 0.005)) + 1;
    for (int i = 0; i <= steps; ++i) {
      if (!free(a + (b - a) * i / steps)) return false;
    }
    return true;
  }
};

TEST_F(Planning, GoesRoundWhatStandsInTheWay) {
  model.setBoard(kMount);
  ASSERT_TRUE(free(left) && free(right));
  ASSERT_FALSE(freeAlong(left, right));
  const auto path = planPath(kinematics, free, left, right);
  ASSERT_TRUE(path);
  EXPECT_LT((path->front() - left).norm(), 1e-12);
  EXPECT_LT((path->back() - right).norm(), 1e-12);
  ASSERT_GE(path->size(), 3u);
  for (std::size_t i = 1; i < path->size(); ++i) EXPECT_TRUE(freeAlong((*path)[i - 1], (*path)[i])) << i;
}

TEST_F(Planning, StraightWhereNothingIsInTheWay) {
  const auto everywhere = [](const Eigen::VectorXd&) { return true; };
  const auto path = planPath(kinematics, everywhere, left, right);
  ASSERT_TRUE(path);
  EXPECT_EQ(path->size(), 2u);
}

TEST_F(Planning, SaysSoWhenThereIsNoWay) {
  const auto wall = [](const Eigen::VectorXd& q) { return std::abs(q[0] - M_PI) > 0.1; };
  PathOptions options;
  options.max_iterations = 500;
  options.joint_margin_rad = 0.05;
  // Round the other way would need more than half a turn beyond the ends.
  EXPECT_FALSE(planPath(kinematics, wall, left, right, options).has_value());
  const auto nowhere = [](const Eigen::VectorXd&) { return false; };
  EXPECT_FALSE(planPath(kinematics, nowhere, left, right, options).has_value());
}

}  // namespace
}  // namespace servocal::robot
