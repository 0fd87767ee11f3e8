// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint.h"

#include <gtest/gtest.h>

#include <iostream>

#include "joint_arm.h"
#include "joint_scene.h"
#include "servocal/robot/kinematics.h"

namespace servocal::procedure {
namespace {

const test::Noise kNoise{0.2, 1e-4, 2.5e-4};

struct Recorded {
  test::Cell cell = test::makeCell(3);
  std::vector<Observation> observations, kept;
};

Recorded record(int stops) {
  Recorded out;
  std::mt19937_64 random(8);
  out.observations = test::observeAll(out.cell, test::randomStops(out.cell, stops, random), kNoise, random);
  out.kept = test::observeAll(out.cell, test::randomStops(out.cell, 12, random), kNoise, random);
  return out;
}

SolveOptions declared() {
  SolveOptions options;
  options.robot_sigma_m = 3e-4;  // three times what it is
  options.robot_sigma_rad = 5e-4;
  options.workspace = Box{"", {0.2, -0.4, 0.2}, {0.9, 0.4, 0.8}};
  return options;
}

/// Largest error of a pose in standard deviations.
double zOf(const JointCameraResult& camera, const Eigen::Isometry3d& truth) {
  Eigen::Matrix<double, 6, 1> error;
  error << camera.pose.translation() - truth.translation(),
      Pose<Base, Base>(Eigen::Matrix3d(camera.pose.linear() * truth.linear().transpose()), {0, 0, 0})
          .rotationVector();
  return error.cwiseQuotient(camera.pose_covariance.diagonal().cwiseSqrt()).cwiseAbs().maxCoeff();
}

TEST(SolveJointly, FindsTheCellAndSaysHowWell) {
  const Recorded recorded = record(40);
  const JointAnswer answer =
      solveJointly(recorded.cell.board, recorded.observations, recorded.kept, declared());
  ASSERT_TRUE(answer.result) << answer.problem;
  const JointResult& joint = *answer.result;
  EXPECT_EQ(answer.problem, "");
  ASSERT_EQ(joint.cameras.size(), 2u);
  for (std::size_t k = 0; k < 2; ++k) {
    const JointCameraResult& camera = joint.cameras[k];
    EXPECT_EQ(camera.stream, recorded.cell.cameras[k].stream);
    EXPECT_LT(zOf(camera, recorded.cell.cameras[k].pose), 5.0);
    EXPECT_GT(camera.views, 15);
    EXPECT_NEAR(camera.range_m, 0.6, 0.1);
    EXPECT_GT(camera.at_range.worst_px, camera.at_range.rms_px);
    EXPECT_LT(camera.at_range.worst_px, 3.0);
    EXPECT_EQ(camera.at_range.sigma_px.size(), 13u * 9u);
    EXPECT_GT(camera.workspace.seen, 10);
    EXPECT_LT(camera.workspace.rms_m, 0.003);
  }
  EXPECT_NEAR(joint.robot_sigma_m, kNoise.robot_m, 0.4 * kNoise.robot_m);
  EXPECT_EQ(joint.declared_sigma_m, 3e-4);
  EXPECT_TRUE(joint.robot_terms.empty());
  EXPECT_EQ(joint.board_bow_x_m, 0.0);
  EXPECT_TRUE(joint.faults.empty()) << joint.faults.front();
  ASSERT_TRUE(joint.held_out);
  EXPECT_GE(joint.held_out->views, 12);
  EXPECT_NEAR(joint.held_out->z, 1.0, 0.25);
  std::cout << joint.model << '\n';
}

// Views that are kept from the solver leave it as it is; without them the error is that of a
// cross-validation.
TEST(SolveJointly, DoesNotLookAtWhatIsHeldOut) {
  const Recorded recorded = record(40);
  const JointAnswer with =
      solveJointly(recorded.cell.board, recorded.observations, recorded.kept, declared());
  const JointAnswer without = solveJointly(recorded.cell.board, recorded.observations, {}, declared());
  ASSERT_TRUE(with.result && without.result);
  EXPECT_EQ(with.result->cameras[0].pose.matrix(), without.result->cameras[0].pose.matrix());
  ASSERT_TRUE(without.result->held_out);
  EXPECT_GT(without.result->held_out->views, 40);
  EXPECT_NEAR(without.result->held_out->z, 1.0, 0.15);
  ASSERT_FALSE(without.result->notes.empty());
  EXPECT_NE(without.result->notes.back().find("cross-validation"), std::string::npos);
}

TEST(SolveJointly, HoldsGivenIntrinsics) {
  const Recorded recorded = record(25);
  SolveOptions options = declared();
  for (const test::CellCamera& camera : recorded.cell.cameras) {
    options.given_intrinsics.emplace(std::pair(camera.name, camera.stream), camera.model);
  }
  const JointAnswer answer = solveJointly(recorded.cell.board, recorded.observations, {}, options);
  ASSERT_TRUE(answer.result) << answer.problem;
  for (std::size_t k = 0; k < 2; ++k) {
    const JointCameraResult& camera = answer.result->cameras[k];
    EXPECT_LT((camera.model.parameters - recorded.cell.cameras[k].model.parameters).norm(), 0.01);
    EXPECT_EQ(camera.sigma.norm(), 0.0);
    EXPECT_LT(zOf(camera, recorded.cell.cameras[k].pose), 5.0);
  }
}

/// Stops of an arm that is off by these terms, as it reports them.
std::vector<Observation> observeBy(const test::Cell& cell, int stops, const ArmConfig& arm,
                                   const calib::RobotTerms& terms, const Eigen::VectorXd& truth,
                                   std::mt19937_64& random) {
  const robot::Kinematics kinematics(arm);
  Eigen::VectorXd seed(6);
  seed << 0.0, -1.5, 1.5, -1.5, -1.5, 0.0;
  std::vector<Observation> out;
  for (const test::CellStop& stop : test::randomStops(cell, stops, random)) {
    const auto q = kinematics.inverse(stop.bMe, seed);
    if (!q) continue;
    RobotState state;
    state.q = *q;
    const Eigen::Matrix<double, 6, 1> off = terms.jacobian(state) * truth;
    const auto error = Pose<EndEffector, EndEffector>::fromRotationVector(off.tail<3>(), off.head<3>());
    out.push_back(
        test::observe(cell, {stop.bMe * error, *q}, static_cast<std::int64_t>(out.size()), kNoise, random));
    out.back().robot->bMe = out.back().robot->bMe * error.inverse();
  }
  return out;
}

/// Arms so many times worse than declared, solved with the errors of their geometry and with the arm as it
/// reports.
struct Corrected {
  double error_over_claim = 0.0;  // Root of the cameras' chi-square over its degrees of freedom.
  double error_m = 0.0, error_without_m = 0.0;  // RMS of the cameras' positions.
};

Corrected correct(double times_worse) {
  const ArmConfig arm;
  const test::Cell cell = test::makeCell(3);
  const calib::RobotTerms terms = armTerms(arm, {}).value();
  std::normal_distribution<double> normal;
  Corrected out;
  double chi_square = 0.0, poses = 0.0;
  for (int seed = 1; seed <= 6; ++seed) {
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    Eigen::VectorXd truth = times_worse * terms.prior_sigma;
    for (double& value : truth) value *= normal(random);
    const auto observations = observeBy(cell, 80, arm, terms, truth, random);
    calib::JointOptions options;
    options.board.bow = false;
    const auto without = calib::solveJoint(cell.board, observations, options).solution;
    options.robot_terms = terms;
    const auto solution = calib::solveJoint(cell.board, observations, options).solution;
    EXPECT_TRUE(solution && without);
    if (!solution || !without) continue;
    const Eigen::VectorXd errors = test::errorsOf(*solution, cell), plain = test::errorsOf(*without, cell);
    for (std::size_t k = 0; k < solution->cameras.size(); ++k) {
      const int at = solution->cameras[k].pose_at;
      const Eigen::Matrix<double, 6, 1> off = errors.segment<6>(at);
      const Eigen::Matrix<double, 6, 6> covariance = solution->covariance.block<6, 6>(at, at);
      chi_square += off.dot(covariance.ldlt().solve(off));
      out.error_m += off.head<3>().squaredNorm();
      out.error_without_m += plain.segment<3>(without->cameras[k].pose_at).squaredNorm();
      poses += 1.0;
    }
  }
  out.error_over_claim = std::sqrt(chi_square / (6.0 * poses));
  out.error_m = std::sqrt(out.error_m / poses);
  out.error_without_m = std::sqrt(out.error_without_m / poses);
  std::cout << "an arm " << times_worse << " times worse than declared: error over claim "
            << out.error_over_claim << "; off by " << 1e3 * out.error_m << " mm, without correction "
            << 1e3 * out.error_without_m << " mm\n";
  return out;
}

// How good the arm's geometry is, is estimated too: believed as declared, an arm four times worse would make
// all claims too small. The worse it is, the more its correction is worth.
TEST(SolveJoint, ClaimsFollowTheArmsGeometry) {
  const Corrected as_declared = correct(1.0), worse = correct(4.3);
  for (const Corrected& corrected : {as_declared, worse}) {
    EXPECT_GT(corrected.error_over_claim, 0.7);
    EXPECT_LT(corrected.error_over_claim, 1.3);
  }
  // Twelve cameras say this to a fifth: 0.53 with the noise that gcc's order of evaluation draws, 0.61 with clang's.
  EXPECT_LT(as_declared.error_m, 0.7 * as_declared.error_without_m);
  EXPECT_LT(worse.error_m, 0.5 * worse.error_without_m);
}

// An arm that is not as its description says: the terms come in, and the cameras are found better for it.
TEST(SolveJointly, CorrectsTheArmsGeometryWhereTheViewsSupportIt) {
  const ArmConfig arm;
  const calib::RobotTerms terms = armTerms(arm, {}).value();
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  Eigen::VectorXd truth = terms.prior_sigma;
  for (double& value : truth) value *= normal(random);

  Recorded recorded;
  recorded.observations = observeBy(recorded.cell, 90, arm, terms, truth, random);
  ASSERT_GT(recorded.observations.size(), 40u);
  SolveOptions options = declared();
  const JointAnswer plain = solveJointly(recorded.cell.board, recorded.observations, {}, options);
  options.arm = arm;
  const JointAnswer corrected = solveJointly(recorded.cell.board, recorded.observations, {}, options);
  ASSERT_TRUE(plain.result && corrected.result) << plain.problem << corrected.problem;
  EXPECT_TRUE(plain.result->robot_terms.empty());
  ASSERT_EQ(corrected.result->robot_terms.size(), terms.names.size()) << corrected.result->model;
  EXPECT_LT(corrected.result->robot_sigma_m, 0.5 * plain.result->robot_sigma_m);
  EXPECT_LT(corrected.result->held_out->rms_px, 0.7 * plain.result->held_out->rms_px);
  EXPECT_LT(zOf(corrected.result->cameras[0], recorded.cell.cameras[0].pose), 5.0);
  std::cout << recorded.observations.size() << " stops; robot noise " << 1e3 * plain.result->robot_sigma_m
            << " mm -> " << 1e3 * corrected.result->robot_sigma_m << " mm, held out "
            << plain.result->held_out->rms_px << " px -> " << corrected.result->held_out->rms_px << " px; "
            << corrected.result->model << '\n';
}

// Too few stops to correct the arm's geometry by: the cameras are where they were found without it, and the
// claim counts what the arm may be off by.
TEST(SolveJointly, CountsTheArmsAccuracyWhereItsGeometryIsNotCorrected) {
  Recorded recorded = record(32);
  const ArmConfig arm;
  const robot::Kinematics kinematics(arm);
  Eigen::VectorXd seed(6);
  seed << 0.0, -1.5, 1.5, -1.5, -1.5, 0.0;
  std::vector<Observation> reached;
  for (Observation& observation : recorded.observations) {
    const auto q = kinematics.inverse(observation.robot->bMe, seed);
    if (!q) continue;
    observation.robot->q = *q;
    reached.push_back(observation);
  }
  ASSERT_GT(reached.size(), 12u);
  SolveOptions options = declared();
  const JointAnswer exact = solveJointly(recorded.cell.board, reached, {}, options);
  options.arm = arm;
  const JointAnswer honest = solveJointly(recorded.cell.board, reached, {}, options);
  ASSERT_TRUE(exact.result && honest.result) << exact.problem << honest.problem;
  ASSERT_TRUE(honest.result->robot_terms.empty()) << honest.result->model;
  // As much as an estimate of that geometry would leave open.
  std::vector<std::string> notes;
  calib::JointOptions joint = jointOptions(reached, options, notes);
  joint.robot_terms = geometryTerms(reached, options, notes);
  const auto freed = calib::solveJoint(recorded.cell.board, reached, joint).solution;
  ASSERT_TRUE(freed);
  for (std::size_t k = 0; k < exact.result->cameras.size(); ++k) {
    const JointCameraResult& without = exact.result->cameras[k];
    const JointCameraResult& with = honest.result->cameras[k];
    EXPECT_LT((with.pose.translation() - without.pose.translation()).norm(), 1e-9);
    const double exact_m2 = without.pose_covariance.diagonal().head(3).sum();
    EXPECT_GT(with.pose_covariance.diagonal().head(3).sum(), 1.5 * exact_m2);
    const double freed_m2 = freed->sigma.segment<3>(freed->cameras[k].pose_at).squaredNorm();
    EXPECT_NEAR(with.pose_covariance.diagonal().head(3).sum(), freed_m2, 0.15 * freed_m2);
  }
}

TEST(SolveJointly, SaysWhyThereIsNoAnswer) {
  Recorded recorded = record(25);
  std::vector<Observation> few(recorded.observations.begin(), recorded.observations.begin() + 2);
  EXPECT_EQ(solveJointly(recorded.cell.board, few, {}, declared()).problem,
            calib::toString(calib::JointStatus::kTooFewViews));

  std::vector<Observation> strange = recorded.observations;
  strange[0].views[0].detection.corners[0].id = 4711;  // not a corner of the board: a caller's mistake
  const JointAnswer answer = solveJointly(recorded.cell.board, strange, {}, declared());
  EXPECT_FALSE(answer.result);
  EXPECT_NE(answer.problem.find("4711"), std::string::npos) << answer.problem;

  for (Observation& observation : recorded.observations) observation.robot.reset();
  const JointAnswer images = solveJointly(recorded.cell.board, recorded.observations, {}, declared());
  EXPECT_FALSE(images.result);
  EXPECT_EQ(images.problem, "");
}

TEST(SolveJointly, NamesAnArmFileThatIsGone) {
  const Recorded recorded = record(25);
  std::vector<Observation> observations = recorded.observations;
  for (Observation& observation : observations) observation.robot->q = Eigen::VectorXd::Zero(6);
  SolveOptions options = declared();
  options.arm.emplace().urdf = "/nowhere/arm.urdf";
  const JointAnswer answer = solveJointly(recorded.cell.board, observations, {}, options);
  ASSERT_TRUE(answer.result) << answer.problem;
  ASSERT_FALSE(answer.result->notes.empty());
  EXPECT_NE(answer.result->notes.front().find("/nowhere/arm.urdf"), std::string::npos);
}

}  // namespace
}  // namespace servocal::procedure
