// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_step.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <set>

#include "se3.h"

namespace servocal::calib {
namespace {

constexpr int kLeastOnEitherSide = 5;

/// What can move as one: the board, or a camera with all its streams.
struct Body {
  std::string camera;          // empty: the board
  Eigen::MatrixXd moves;       // layout.size x 6: shared parameters by a displacement and a turn of the body
  Matrix6d faked;              // covariance of what the arm can make look like a step
  std::set<std::size_t> seen;  // stops
};

/// By a displacement and a turn about where the board was, `lever_m` being the way from there to the body's
/// origin.
Matrix6d fakedBy(const RobotNoise& robot, const Eigen::Vector3d& lever_m) {
  Matrix6d by = Matrix6d::Identity();
  by.topRightCorner<3, 3>() = -skew(lever_m);
  Vector6d variance;
  variance << Eigen::Vector3d::Constant(robot.declared_m * robot.declared_m),
      Eigen::Vector3d::Constant(robot.declared_rad * robot.declared_rad);
  return by * variance.asDiagonal() * by.transpose();
}

/// Mean place of the board in the frame the cameras stand in, by the views of one stream.
Eigen::Vector3d meanBoard(const JointProblem& problem, const JointState& state, std::size_t stream) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double views = 0;
  for (const JointView& view : problem.views()) {
    if (view.camera != stream) continue;
    const Eigen::Isometry3d cMo = problem.boardPose(state, view, problem.correction(state, view.stop));
    sum += state.cameras[stream].lMc * cMo.translation();
    ++views;
  }
  return views > 0 ? Eigen::Vector3d(sum / views) : state.cameras[stream].lMc.translation();
}

std::vector<Body> bodiesOf(const JointProblem& problem, const JointState& state,
                           const JointSolution& solution) {
  const Eigen::MatrixXd nothing = Eigen::MatrixXd::Zero(problem.layout().size, 6);
  std::vector<Body> bodies = {{"", nothing, fakedBy(solution.robot, Eigen::Vector3d::Zero()), {}}};
  bodies[0].moves.middleRows<6>(solution.board_at).setIdentity();
  std::vector<std::size_t> body_of;
  Eigen::Vector3d origin_l;
  for (std::size_t k = 0; k < solution.cameras.size(); ++k) {
    const JointCamera& camera = solution.cameras[k];
    const Eigen::Vector3d place_l = camera.pose.translation();
    if (k == 0 || bodies.back().camera != camera.camera) {
      origin_l = place_l;
      bodies.push_back(
          {camera.camera, nothing, fakedBy(solution.robot, origin_l - meanBoard(problem, state, k)), {}});
    }
    auto rows = bodies.back().moves.middleRows<6>(camera.pose_at);
    rows.setIdentity();
    rows.topRightCorner<3, 3>() = -skew(place_l - origin_l);
    body_of.push_back(bodies.size() - 1);
  }
  for (const JointView& view : problem.views()) {
    bodies[0].seen.insert(view.stop);
    bodies[body_of[view.camera]].seen.insert(view.stop);
  }
  return bodies;
}

bool isSeenOnBothSides(const Body& body, std::size_t stop) {
  const auto split = body.seen.lower_bound(stop);
  return std::distance(body.seen.begin(), split) >= kLeastOnEitherSide &&
         std::distance(split, body.seen.end()) >= kLeastOnEitherSide;
}

}  // namespace

JointStep bestStep(const JointProblem& problem, const JointState& state, const JointSolution& solution) {
  const int size = problem.layout().size;
  const std::vector<Body> bodies = bodiesOf(problem, state, solution);
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(size);
  Eigen::MatrixXd total = matrix;
  for (std::size_t stop = 0; stop < problem.stops().size(); ++stop) {
    if (const auto own = problem.linearizeStop(state, stop)) total += reducedMatrix(*own);
  }
  JointStep best;
  for (std::size_t stop = problem.stops().size(); stop-- > 0;) {
    const std::optional<ArrowSystem> own = problem.linearizeStop(state, stop);
    if (!own) continue;
    const ArrowSystem::Block& block = own->blocks.front();
    matrix += reducedMatrix(*own);
    gradient += own->gradient - block.cross * block.matrix.ldlt().solve(block.gradient);
    for (const Body& body : bodies) {
      if (!isSeenOnBothSides(body, stop)) continue;
      const Eigen::MatrixXd cross = body.moves.transpose() * matrix;
      const Matrix6d whole = body.moves.transpose() * total * body.moves;
      const Matrix6d score = cross * body.moves - cross * solution.covariance * cross.transpose();
      // Where one side says next to nothing of some direction, any small thing that is not in the model makes
      // a step.
      constexpr double kLeastShare = 0.02;
      if (!(whole.diagonal().minCoeff() > 0)) continue;
      const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix6d> shares(score, whole, Eigen::EigenvaluesOnly);
      if (shares.info() != Eigen::Success || !(shares.eigenvalues().minCoeff() > kLeastShare)) continue;
      const Vector6d slope = body.moves.transpose() * gradient;
      // Of the step -score^-1 slope, whose covariance is score^-1 and what the arm fakes.
      const Matrix6d spread = score + score * body.faked * score;
      const double chi_square = slope.dot(spread.ldlt().solve(slope));
      if (chi_square > best.chi_square) best = {chi_square, stop, body.camera, -score.ldlt().solve(slope)};
    }
  }
  return best;
}

}  // namespace servocal::calib
