// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot/kinematics.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <future>
#include <random>

#include "servocal/core/error.h"

namespace servocal::robot {
namespace {

constexpr double kPi = 3.14159265358979323846;

Eigen::VectorXd randomJoints(std::mt19937_64& random, int joints, double half_range) {
  std::uniform_real_distribution<double> uniform(-half_range, half_range);
  Eigen::VectorXd q(joints);
  for (double& angle : q) angle = uniform(random);
  return q;
}

// The product of the Denavit-Hartenberg rows, written independently of the URDF.
Pose<Base, EndEffector> ur5ByDenavitHartenberg(const Eigen::VectorXd& q) {
  const double d[] = {0.089159, 0, 0, 0.10915, 0.09465, 0.0823};
  const double a[] = {0, -0.425, -0.39225, 0, 0, 0};
  const double alpha[] = {kPi / 2, 0, 0, kPi / 2, -kPi / 2, 0};
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  for (int i = 0; i < 6; ++i)
    pose = pose * Eigen::AngleAxisd(q[i], Eigen::Vector3d::UnitZ()) * Eigen::Translation3d(a[i], 0, d[i]) *
           Eigen::AngleAxisd(alpha[i], Eigen::Vector3d::UnitX());
  return Pose<Base, EndEffector>(pose);
}

std::filesystem::path writeUrdf(const std::string& name, const std::string& text) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / name;
  std::ofstream(file) << text;
  return file;
}

ArmConfig sevenAxes() {
  // Dimensions like a Panda's.
  const char* origins[] = {"xyz='0 0 0.333' rpy='0 0 0'",      "xyz='0 0 0' rpy='-1.5708 0 0'",
                           "xyz='0 -0.316 0' rpy='1.5708 0 0'", "xyz='0.0825 0 0' rpy='1.5708 0 0'",
                           "xyz='-0.0825 0.384 0' rpy='-1.5708 0 0'", "xyz='0 0 0' rpy='1.5708 0 0'",
                           "xyz='0.088 0 0' rpy='1.5708 0 0'"};
  const double limits[][2] = {{-2.9, 2.9}, {-1.76, 1.76}, {-2.9, 2.9}, {-3.07, -0.07}, {-2.9, 2.9}, {-0.02, 3.75}, {-2.9, 2.9}};
  std::string text = "<robot name='seven'><link name='l0'/>";
  for (int i = 0; i < 7; ++i) {
    const std::string n = std::to_string(i), m = std::to_string(i + 1);
    text += "<link name='l" + m + "'/><joint name='j" + m + "' type='revolute'><parent link='l" + n +
            "'/><child link='l" + m + "'/><origin " + origins[i] + "/><axis xyz='0 0 1'/><limit lower='" +
            std::to_string(limits[i][0]) + "' upper='" + std::to_string(limits[i][1]) +
            "' velocity='2' effort='10'/></joint>";
  }
  text += "<link name='hand'/><joint name='tip' type='fixed'><parent link='l7'/><child link='hand'/>"
          "<origin xyz='0 0 0.107'/></joint></robot>";
  ArmConfig arm;
  arm.urdf = writeUrdf("seven.urdf", text).string();
  arm.base_link = "l0";
  arm.flange_link = "hand";
  return arm;
}

TEST(Kinematics, BuiltInArmStandsWhereItsTableSays) {
  const Kinematics kinematics{ArmConfig{}};
  ASSERT_EQ(kinematics.joints(), 6);
  EXPECT_DOUBLE_EQ(kinematics.lower()[0], -2 * kPi);
  EXPECT_DOUBLE_EQ(kinematics.upper()[5], 2 * kPi);
  const Pose<Base, EndEffector> bMe = kinematics.forward(Eigen::VectorXd::Zero(6));
  EXPECT_LT((bMe.translation() - Eigen::Vector3d(-0.81725, -0.19145, -0.005491)).norm(), 1e-12);

  std::mt19937_64 random(11);
  for (int i = 0; i < 200; ++i) {
    const Eigen::VectorXd q = randomJoints(random, 6, 2 * kPi);
    EXPECT_LT(distanceM(kinematics.forward(q), ur5ByDenavitHartenberg(q)), 1e-12);
    EXPECT_LT(angleRad(kinematics.forward(q), ur5ByDenavitHartenberg(q)), 1e-11);
  }
}

// Axes along, against and beside the frame's, with fixed joints at both ends; the pose as a product of Eigen's turns.
ArmConfig axesOfAllKinds(std::vector<Eigen::Vector3d>& axes) {
  axes = {{0, 0, 1}, {0, 1, 0}, {1, 0, 0}, {0, 0, -1}, {0, -1, 0}, {0.6, 0, 0.8}, {-0.48, 0.64, 0.6}};
  std::string text = "<robot name='all'><link name='b'/><link name='l0'/><joint name='base' type='fixed'><parent link='b'/>"
                     "<child link='l0'/><origin xyz='0.1 0.2 0.3' rpy='0.3 0 0'/></joint>";
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const std::string n = std::to_string(i), m = std::to_string(i + 1);
    text += "<link name='l" + m + "'/><joint name='j" + m + "' type='revolute'><parent link='l" + n + "'/><child link='l" + m +
            "'/><origin xyz='0.05 -0.02 0.15' rpy='0.2 -0.4 0.7'/><axis xyz='" + std::to_string(axes[i].x()) + " " +
            std::to_string(axes[i].y()) + " " + std::to_string(axes[i].z()) +
            "'/><limit lower='-3' upper='3' velocity='2' effort='10'/></joint>";
  }
  text += "<link name='hand'/><joint name='tip' type='fixed'><parent link='l7'/><child link='hand'/>"
          "<origin xyz='0 0.03 0.1' rpy='0 0.5 0'/></joint></robot>";
  ArmConfig arm;
  arm.urdf = writeUrdf("all.urdf", text).string();
  arm.base_link = "b";
  arm.flange_link = "hand";
  return arm;
}

TEST(Kinematics, TurnsAboutAxesOfAnyDirection) {
  std::vector<Eigen::Vector3d> axes;
  const Kinematics kinematics{axesOfAllKinds(axes)};
  const auto origin = [](double x, double y, double z, double roll, double pitch, double yaw) {
    return Eigen::Isometry3d(Eigen::Translation3d(x, y, z) * Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                             Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()));
  };
  std::mt19937_64 random(37);
  for (int i = 0; i < 50; ++i) {
    const Eigen::VectorXd q = randomJoints(random, 7, 3.0);
    Eigen::Isometry3d pose = origin(0.1, 0.2, 0.3, 0.3, 0, 0);
    for (int k = 0; k < 7; ++k) pose = pose * origin(0.05, -0.02, 0.15, 0.2, -0.4, 0.7) * Eigen::AngleAxisd(q[k], axes[k]);
    const Pose<Base, EndEffector> expected(pose * origin(0, 0.03, 0.1, 0, 0.5, 0));
    EXPECT_LT(distanceM(kinematics.forward(q), expected), 1e-12);
    EXPECT_LT(angleRad(kinematics.forward(q), expected), 1e-7);
  }
}

void checkJacobian(const Kinematics& kinematics, unsigned seed) {
  std::mt19937_64 random(seed);
  const double h = 1e-6;
  for (int i = 0; i < 50; ++i) {
    const Eigen::VectorXd q = randomJoints(random, kinematics.joints(), 2.0);
    const Eigen::MatrixXd jacobian = kinematics.jacobian(q);
    for (int joint = 0; joint < kinematics.joints(); ++joint) {
      Eigen::VectorXd more = q, less = q;
      more[joint] += h;
      less[joint] -= h;
      const auto a = kinematics.forward(less), b = kinematics.forward(more);
      const Eigen::Vector3d linear = (b.translation() - a.translation()) / (2 * h);
      const Eigen::Matrix3d turn = b.rotation() * a.rotation().transpose();
      const Eigen::Vector3d angular(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1));
      EXPECT_LT((jacobian.block<3, 1>(0, joint) - linear).norm(), 1e-8);
      EXPECT_LT((jacobian.block<3, 1>(3, joint) - angular / (4 * h)).norm(), 1e-8);
    }
  }
}

TEST(Kinematics, JacobianIsTheDerivativeAlongTheBaseAxes) {
  checkJacobian(Kinematics{ArmConfig{}}, 13);
  checkJacobian(Kinematics{sevenAxes()}, 17);
  std::vector<Eigen::Vector3d> axes;
  checkJacobian(Kinematics{axesOfAllKinds(axes)}, 19);
}

// Near the seed: the very joint angles, on the seed's turn.
TEST(Kinematics, InverseStaysNearTheSeed) {
  const Kinematics kinematics{ArmConfig{}};
  std::mt19937_64 random(19);
  for (int i = 0; i < 300; ++i) {
    Eigen::VectorXd q = randomJoints(random, 6, 6.0);
    q[4] = q[4] > 0 ? 1.0 : -1.0;  // Away from the wrist's singularity,
    q[2] = q[2] > 0 ? 1.5 : -1.5;  // and the elbow's,
    if (std::abs(kinematics.jacobian(q).determinant()) < 5e-3) continue;  // and the shoulder's.
    const Eigen::VectorXd seed = q + randomJoints(random, 6, 0.05);
    const auto found = kinematics.inverse(kinematics.forward(q), seed, 0.05);
    ASSERT_TRUE(found) << i;
    EXPECT_LT((*found - q).cwiseAbs().maxCoeff(), 0.01) << i;
  }
}

void checkInverse(const Kinematics& kinematics, unsigned seed, int tries, int least_found) {
  std::mt19937_64 random(seed);
  int found_count = 0;
  for (int i = 0; i < tries; ++i) {
    Eigen::VectorXd q(kinematics.joints()), start(kinematics.joints());
    for (int joint = 0; joint < kinematics.joints(); ++joint) {
      const double low = std::max(kinematics.lower()[joint], -kPi) + 0.1;
      const double high = std::min(kinematics.upper()[joint], kPi) - 0.1;
      std::uniform_real_distribution<double> uniform(low, high);
      q[joint] = uniform(random);
      start[joint] = uniform(random);
    }
    const Pose<Base, EndEffector> bMe = kinematics.forward(q);
    const auto found = kinematics.inverse(bMe, start, 0.1);
    if (!found) continue;
    ++found_count;
    EXPECT_LT(distanceM(kinematics.forward(*found), bMe), 1e-4);
    EXPECT_LT(angleRad(kinematics.forward(*found), bMe), 1e-4);
    EXPECT_TRUE((found->array() >= kinematics.lower().array() + 0.1).all());
    EXPECT_TRUE((found->array() <= kinematics.upper().array() - 0.1).all());
    EXPECT_EQ(*found, *kinematics.inverse(bMe, start, 0.1)) << "not repeatable";
  }
  EXPECT_GE(found_count, least_found);
}

TEST(Kinematics, InverseFindsReachablePosesFromFarSeeds) {
  checkInverse(Kinematics{ArmConfig{}}, 23, 200, 198);
  checkInverse(Kinematics{sevenAxes()}, 29, 100, 95);
}

TEST(Kinematics, InverseSaysNothingForPosesOutOfReach) {
  const Kinematics kinematics{ArmConfig{}};
  const Pose<Base, EndEffector> far(Eigen::Matrix3d::Identity(), {0.7, 0.7, 0.7});
  EXPECT_FALSE(kinematics.inverse(far, Eigen::VectorXd::Zero(6)));
  EXPECT_THROW(kinematics.inverse(Pose<Base, EndEffector>(), Eigen::VectorXd::Zero(6)), std::invalid_argument);
  EXPECT_THROW(kinematics.forward(Eigen::VectorXd::Zero(5)), std::invalid_argument);
}

// Both at once, again and again: a solver's memory in what they share shows in some of the poses.
TEST(Kinematics, MayBeSharedBetweenThreads) {
  const Kinematics kinematics{ArmConfig{}};
  std::mt19937_64 random(31);
  std::vector<Eigen::VectorXd> q;
  std::vector<Eigen::Vector3d> alone;
  for (int i = 0; i < 200; ++i) {
    q.push_back(randomJoints(random, 6, 3.0));
    alone.push_back(kinematics.forward(q.back()).translation());
  }
  const auto wrongOf = [&](std::size_t start) {
    int wrong = 0;
    for (std::size_t i = start; i < start + 200 * q.size(); ++i)
      wrong += kinematics.forward(q[i % q.size()]).translation() != alone[i % q.size()];
    return wrong;
  };
  auto other = std::async(std::launch::async, wrongOf, 100);
  EXPECT_EQ(wrongOf(0), 0);
  EXPECT_EQ(other.get(), 0);
}

void expectRefused(const ArmConfig& arm, const std::string& words) {
  try {
    const Kinematics kinematics(arm);
    ADD_FAILURE() << "accepted: " << words;
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInvalidConfig);
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
  }
}

TEST(Kinematics, RefusesDescriptionsItCannotUse) {
  ArmConfig arm;
  arm.urdf = "/nowhere/arm.urdf";
  expectRefused(arm, "cannot be read");
  arm = {};
  arm.flange_link = "tool1";
  expectRefused(arm, "no link 'tool1'");
  arm = {};
  std::swap(arm.base_link, arm.flange_link);
  expectRefused(arm, "no chain");
  arm = {};
  arm.urdf = writeUrdf("broken.urdf", "<robot name='x'><link").string();
  expectRefused(arm, "not a robot description");
  arm.urdf = writeUrdf("sliding.urdf",
                       "<robot name='x'><link name='base'/><link name='tool0'/><joint name='j' type='prismatic'>"
                       "<parent link='base'/><child link='tool0'/><limit lower='0' upper='1' velocity='1' "
                       "effort='1'/></joint></robot>").string();
  expectRefused(arm, "neither turns nor is fixed");
}

}  // namespace
}  // namespace servocal::robot
