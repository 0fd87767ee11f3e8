// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_arm.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <fstream>
#include <random>
#include <regex>
#include <sstream>

#include "servocal/robot/kinematics.h"
#include "temporary_folder.h"

namespace servocal::procedure {
namespace {

std::string slurp(const std::string& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

/// The URDF with the origin of every joint of the arm shifted and turned a little.
std::string misbuilt(const std::string& urdf, double size, std::mt19937_64& random) {
  std::normal_distribution<double> normal(0.0, size);
  static const std::regex origin(R"(<joint [^>]*type="revolute"[^]*?<origin ([^/]*)/>)");
  static const std::regex number(R"(-?[0-9]+(\.[0-9]+)?([eE][-+]?[0-9]+)?)");
  std::string out, rest = urdf;
  for (std::smatch found; std::regex_search(rest, found, origin); rest = found.suffix()) {
    const std::string whole = found.str(), values = found[1];
    std::string changed = values;
    std::ostringstream text;
    text.precision(17);
    std::string::const_iterator at = values.begin();
    for (std::sregex_iterator it(values.begin(), values.end(), number), end; it != end; ++it) {
      text << std::string(at, (*it)[0].first) << std::stod(it->str()) + normal(random);
      at = (*it)[0].second;
    }
    text << std::string(at, values.end());
    out += found.prefix().str() + whole.substr(0, whole.size() - values.size() - 2) + text.str() + "/>";
  }
  return out + rest;
}

/// RMS over joint angles of what the terms (with base and flange free, as poses are in a calibration) leave
/// of the difference between two arms, and of the difference itself.
struct Left {
  double before = 0.0;
  double after = 0.0;
};

Left leftOf(const ArmConfig& arm, const ArmConfig& other, const calib::RobotTerms& terms,
            std::mt19937_64& random) {
  const robot::Kinematics nominal(arm), real(other);
  std::uniform_real_distribution<double> angle(-2.5, 2.5);
  constexpr int kPostures = 40;
  const auto count = static_cast<Eigen::Index>(terms.names.size());
  Eigen::MatrixXd columns(6 * kPostures, count + 12);
  Eigen::VectorXd moved(6 * kPostures);
  for (int i = 0; i < kPostures; ++i) {
    RobotState state;
    state.q.resize(nominal.joints());
    for (double& q : state.q) q = angle(random);
    const auto bMe = nominal.forward(state.q);
    const Pose<EndEffector, EndEffector> off = bMe.inverse() * real.forward(state.q);
    moved.segment<6>(6 * i) << off.translation(), off.rotationVector();
    Eigen::Matrix<double, 6, 6> by_base = Eigen::Matrix<double, 6, 6>::Zero();
    const Eigen::Matrix3d eRb = bMe.rotation().transpose();
    by_base.block<3, 3>(0, 0) = by_base.block<3, 3>(3, 3) = eRb;
    for (int k = 0; k < 3; ++k) {
      by_base.block<3, 1>(0, 3 + k) = eRb * Eigen::Vector3d::Unit(k).cross(bMe.translation());
    }
    columns.middleRows(6 * i, 6) << terms.jacobian(state), by_base, Eigen::Matrix<double, 6, 6>::Identity();
  }
  const Eigen::VectorXd solution = columns.colPivHouseholderQr().solve(moved);
  return {std::sqrt(moved.squaredNorm() / kPostures),
          std::sqrt((moved - columns * solution).squaredNorm() / kPostures)};
}

class ArmTerms : public ::testing::TestWithParam<const char*> {
 protected:
  const test::TemporaryFolder folder_;
  const std::string urdf_ = slurp(GetParam());
  ArmConfig arm_;

  void SetUp() override {
    arm_.urdf = GetParam();
    if (urdf_.find("panda") != std::string::npos) {
      arm_.base_link = "base";
      arm_.flange_link = "flange";
    }
  }
  ArmConfig misbuiltArm(double size, std::mt19937_64& random) const {
    ArmConfig other = arm_;
    other.urdf = folder_.write("other.urdf", misbuilt(urdf_, size, random)).string();
    return other;
  }
};

// Whatever is wrong with the joints' places and axes, the terms describe it: what is left is of second order.
TEST_P(ArmTerms, DescribeEveryErrorOfTheGeometry) {
  std::mt19937_64 random(4);
  const calib::RobotTerms terms = armTerms(arm_, {}).value();
  for (const double size : {1e-4, 1e-3}) {
    const Left left = leftOf(arm_, misbuiltArm(size, random), terms, random);
    EXPECT_GT(left.before, size);
    EXPECT_LT(left.after, 20 * size * size) << "of " << left.before;
  }
}

// None is superfluous: without any one of them some error stays, and no two say the same.
TEST_P(ArmTerms, AreIndependent) {
  std::mt19937_64 random(4);
  const calib::RobotTerms terms = armTerms(arm_, {}).value();
  const ArmConfig other = misbuiltArm(1e-4, random);
  const double whole = leftOf(arm_, other, terms, random).after;
  for (std::size_t i = 0; i < terms.names.size(); ++i) {
    calib::RobotTerms fewer = terms;
    fewer.names.erase(fewer.names.begin() + static_cast<std::ptrdiff_t>(i));
    fewer.jacobian = [&](const RobotState& state) {
      const Eigen::MatrixXd all = terms.jacobian(state);
      Eigen::MatrixXd some(6, all.cols() - 1);
      some << all.leftCols(static_cast<Eigen::Index>(i)),
          all.rightCols(some.cols() - static_cast<Eigen::Index>(i));
      return some;
    };
    EXPECT_GT(leftOf(arm_, other, fewer, random).after, 10 * whole) << terms.names[i];
  }
}

/// What the terms, each off by a standard deviation of its own at random, do to the flange's place at the stops beyond
/// other poses of base and flange; RMS per axis.
double movedM(const calib::RobotTerms& terms, const std::vector<Observation>& stops, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const auto rows = static_cast<Eigen::Index>(3 * stops.size());
  Eigen::MatrixXd by_poses(rows, 9);
  for (std::size_t i = 0; i < stops.size(); ++i) {
    const Pose<Base, EndEffector>& bMe = stops[i].robot->bMe;
    const Eigen::Matrix3d eRb = bMe.rotation().transpose();
    Eigen::Matrix3d turned;
    for (int axis = 0; axis < 3; ++axis) turned.col(axis) = eRb * Eigen::Vector3d::Unit(axis).cross(bMe.translation());
    by_poses.middleRows<3>(static_cast<Eigen::Index>(3 * i)) << eRb, turned, Eigen::Matrix3d::Identity();
  }
  constexpr int kDraws = 200;
  double squares = 0.0;
  for (int draw = 0; draw < kDraws; ++draw) {
    Eigen::VectorXd off = terms.prior_sigma, moved(rows);
    for (double& value : off) value *= normal(random);
    for (std::size_t i = 0; i < stops.size(); ++i) {
      moved.segment<3>(static_cast<Eigen::Index>(3 * i)) = (terms.jacobian(*stops[i].robot) * off).head<3>();
    }
    squares += (moved - by_poses * by_poses.colPivHouseholderQr().solve(moved)).squaredNorm() / static_cast<double>(rows);
  }
  return std::sqrt(squares / kDraws);
}

// The accuracy that is declared is that of the arm, not of each of its eighteen numbers.
TEST(ArmTermsOfTheUr5, TogetherMoveTheFlangeByTheDeclaredAccuracy) {
  ArmConfig arm;
  arm.accuracy_m = 0.0005;
  const robot::Kinematics kinematics(arm);
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> angle(-2.5, 2.5);
  std::vector<Observation> stops(60);
  for (Observation& stop : stops) {
    stop.robot.emplace();
    stop.robot->q = Eigen::VectorXd::NullaryExpr(6, [&] { return angle(random); }) +
                    (Eigen::VectorXd(6) << 0.0, -1.5, 1.5, -1.5, -1.5, 0.0).finished();
    stop.robot->bMe = kinematics.forward(stop.robot->q);
  }
  EXPECT_NEAR(movedM(armTerms(arm, stops).value(), stops, random), 0.0005, 0.00005);
  EXPECT_GT(movedM(armTerms(arm, {}).value(), stops, random), 0.0006);  // Each by itself.
}

TEST(ArmTermsOfTheUr5, AreEighteen) {
  const calib::RobotTerms terms = armTerms(ArmConfig{}, {}).value();
  EXPECT_EQ(terms.names.size(), 18u);
  EXPECT_EQ(terms.names.front(), "link 1 length (m)");
  EXPECT_EQ(terms.prior_sigma.size(), 18);
}

INSTANTIATE_TEST_SUITE_P(Arms, ArmTerms,
                         ::testing::Values(SERVOCAL_SOURCE "/modules/robot/data/ur5.urdf",
                                           SERVOCAL_SOURCE "/tests/data/urdf/panda.urdf"),
                         [](const auto& arm) {
                           return std::string(arm.param).find("panda") != std::string::npos ? "Panda"
                                                                                             : "Ur5";
                         });

}  // namespace
}  // namespace servocal::procedure
