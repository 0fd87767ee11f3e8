// SPDX-License-Identifier: GPL-3.0-or-later
// Predictions by a joint solution: covariance at given parameters, views held out, halves compared.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "joint_noise.h"
#include "joint_prediction.h"
#include "joint_problem.h"
#include "servocal/calib/board_pose.h"
#include "servocal/calib/uncertainty.h"

namespace servocal::calib {
namespace {

/// Covariance of a view's residual: corners, robot, solution.
Eigen::MatrixXd spreadOf(const JointProblem& problem, const JointSolution& solution, const JointView& view,
                         const JointResidual& seen) {
  const JointLayout& layout = problem.layout();
  const JointLayout::Camera& camera = layout.cameras[view.camera];
  const Eigen::Index own = camera.size(), common = 6 + layout.shapeSize(),
                     terms = layout.size - layout.terms_at;
  Eigen::MatrixXd by = Eigen::MatrixXd::Zero(seen.jacobian.rows(), layout.size);
  by.middleCols(camera.at, own) = seen.jacobian.leftCols(own);
  by.middleCols(layout.board_at, common) = seen.jacobian.middleCols(own, common);
  const Eigen::MatrixXd by_stop = seen.jacobian.rightCols<6>();
  if (terms > 0) by.rightCols(terms) = by_stop * problem.stops()[view.stop].by_terms;
  Vector6d robot;
  robot << Eigen::Vector3d::Constant(std::pow(problem.noise().robot_m, 2)),
      Eigen::Vector3d::Constant(std::pow(problem.noise().robot_rad, 2));
  Eigen::MatrixXd out =
      by * solution.covariance * by.transpose() + by_stop * robot.asDiagonal() * by_stop.transpose();
  out.diagonal().array() += 1.0;
  return out;
}

/// RMS distance of the board's corners between two poses, m.
double cornerRmsM(const JointProblem& problem, const JointState& state, const JointView& view,
                  const Eigen::Isometry3d& first, const Eigen::Isometry3d& second) {
  double squares = 0;
  for (const Corner& corner : view.detection->corners) {
    const Eigen::Vector3d point = problem.point(state, corner.id, view.turn);
    squares += (first * point - second * point).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(view.detection->corners.size()));
}

}  // namespace

Eigen::MatrixXd jointCovarianceAt(const BoardSpec& board, const std::vector<Observation>& observations,
                                  const JointSolution& at) {
  const JointPrediction prediction(board, observations, at);
  const auto system = prediction.problem().linearize(prediction.state());
  if (!system)
    throw std::invalid_argument("a corner of the observations does not project with these parameters");
  return scaledInverse(reducedMatrix(*system));
}

HeldOut predictHeldOut(const BoardSpec& board, const std::vector<Observation>& observations,
                       const JointSolution& solution) {
  const JointPrediction prediction(board, observations, solution);
  const JointProblem& problem = prediction.problem();
  const JointState& state = prediction.state();
  HeldOut out;
  double squares_px2 = 0, squares_m2 = 0, corners = 0, chi_square = 0, degrees = 0;
  for (const JointView& view : problem.views()) {
    const JointCamera& camera = solution.cameras[view.camera];
    const Observation& observation = *problem.stops()[view.stop].observation;
    const auto seen = problem.residual(state, view);
    if (!seen) {
      out.notes.push_back(camera.camera + ": observation " + std::to_string(observation.id) +
                          " is predicted outside the lens model's reach");
      continue;
    }
    HeldOutView held{observation.id, camera.camera, camera.stream, 0.0, NAN, 0.0, 0, 0.0};
    const Eigen::Isometry3d cMo = problem.boardPose(state, view, problem.correction(state, view.stop));
    double squares = 0;
    for (const Corner& corner : view.detection->corners) {
      const auto pixel = camera.model.project(cMo * problem.point(state, corner.id, view.turn));
      squares += (*pixel - corner.pixel).squaredNorm();
    }
    const auto count = static_cast<double>(view.detection->corners.size());
    held.rms_px = std::sqrt(squares / count);
    held.degrees = static_cast<int>(seen->residual.size());
    const Eigen::LDLT<Eigen::MatrixXd> spread(spreadOf(problem, solution, view, *seen));
    held.chi_square = seen->residual.dot(spread.solve(seen->residual));
    // In px of the claim, so that solutions with other corner scales compare.
    held.log_density = -0.5 * (held.chi_square + spread.vectorD().array().log().sum()) -
                       held.degrees * std::log(camera.corner_scale);
    squares_px2 += squares;
    corners += count;
    chi_square += held.chi_square;
    degrees += held.degrees;
    const auto alone = refineBoardPose(
        board, camera.model, problem.turns().turned(*view.detection, view.turn), Pose<Color, Board>(cMo));
    if (alone) {
      held.error_m = cornerRmsM(problem, state, view, alone->cMo.isometry(), cMo);
      squares_m2 += held.error_m * held.error_m * count;
    } else {
      out.notes.push_back(camera.camera + ": observation " + std::to_string(observation.id) +
                          " gives no board pose of its own");
    }
    out.views.push_back(held);
  }
  if (corners > 0) {
    out.rms_px = std::sqrt(squares_px2 / corners);
    out.rms_m = std::sqrt(squares_m2 / corners);
    out.z = std::sqrt(chi_square / degrees);
  }
  return out;
}

}  // namespace servocal::calib
