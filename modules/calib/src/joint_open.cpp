// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_open.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>

namespace servocal::calib {
namespace {

/// What a direction is about: how much of it lies in which kind of parameter.
struct Share {
  double position = 0.0, turn = 0.0;  // of the camera
  double board = 0.0;                 // position and turn of the board
  double focal = 0.0, center = 0.0, distortion = 0.0;
};

/// The axis about which the robot turned most, and how much of its turning was about that axis: 1 if all.
struct TurnAxis {
  Eigen::Vector3d axis_e = Eigen::Vector3d::UnitZ();
  double share = 0.0;
};

TurnAxis turnAxis(const JointProblem& problem) {
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  const std::vector<JointStop>& stops = problem.stops();
  for (const JointStop& stop : stops) {
    const Eigen::AngleAxisd turn(stops.front().bMe.linear().transpose() * stop.bMe.linear());
    const Eigen::Vector3d vector = turn.angle() * turn.axis();
    scatter += vector * vector.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(scatter);
  const double total = scatter.trace();
  return {eigen.eigenvectors().col(2), total > 0 ? eigen.eigenvalues()[2] / total : 0.0};
}

std::string sentenceOf(const JointProblem& problem, std::size_t k, const Share& share) {
  const JointStream& stream = problem.options().streams[k];
  const std::string camera = stream.camera + " " + toString(stream.stream);
  const double lens = std::max({share.focal, share.center, share.distortion});
  if (lens > std::max({share.position, share.turn, share.board})) {
    if (share.distortion == lens) {
      return "distortion of " + camera +
             " is open: show the board nearer to the borders and corners of the image, "
             "or hold the higher terms fixed";
    }
    return std::string(share.focal == lens ? "focal length" : "principal point") + " of " + camera +
           " is open: tilt the board by 20 degrees or more in several directions, and show it at a second "
           "distance";
  }
  const TurnAxis turn = turnAxis(problem);
  if (share.board > 0.1 && turn.share > 0.9) {
    char axis[64];
    std::snprintf(axis, sizeof axis, "(%.2f, %.2f, %.2f)", turn.axis_e.x(), turn.axis_e.y(), turn.axis_e.z());
    return "the place of " + camera +
           " and that of the board cannot be told apart: the flange turned almost only "
           "about its axis " +
           axis + "; rotate more about axes across it";
  }
  if (share.board > 0.1) {
    return "the place of " + camera +
           " and that of the board cannot be told apart: rotate the flange more, about "
           "two different axes, by 30 degrees or more";
  }
  return std::string(share.position >= share.turn ? "position" : "orientation") + " of " + camera +
         " is open: it saw too few different board poses; show the board at more places, tilted";
}

/// The parameters that directions are sought among.
std::vector<int> judged(const JointLayout& layout) {
  std::vector<int> out;
  for (int i = 0; i < layout.shape_at; ++i) out.push_back(i);
  return out;
}

}  // namespace

std::vector<OpenDirection> openDirections(const JointProblem& problem, const JointState& state,
                                          const Eigen::MatrixXd& covariance) {
  const JointLayout& layout = problem.layout();
  const std::vector<int> among = judged(layout);
  const auto count = static_cast<Eigen::Index>(among.size());
  const Eigen::VectorXd scales = problem.scales(state);
  const Eigen::VectorXd inverse = scales.head(count).cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
      inverse.asDiagonal() * covariance.topLeftCorner(count, count) * inverse.asDiagonal());
  std::vector<OpenDirection> out;
  for (Eigen::Index d = count - 1; d >= 0; --d) {
    const double sigma = std::sqrt(std::max(0.0, eigen.eigenvalues()[d]));
    if (sigma <= problem.options().undetermined_share) break;
    OpenDirection open;
    constexpr double kOnlyTheAnchor = 10.0;  // the anchor's own is 32
    open.sigma = sigma > kOnlyTheAnchor ? INFINITY : sigma;
    open.direction = Eigen::VectorXd::Zero(layout.size);
    open.direction.head(count) = eigen.eigenvectors().col(d);
    Eigen::Index largest = 0;
    open.direction.cwiseAbs().maxCoeff(&largest);
    if (open.direction[largest] < 0) open.direction = -open.direction;

    const Eigen::VectorXd squares = open.direction.cwiseAbs2();
    std::size_t worst = 0;
    double most = -1.0;
    std::vector<Share> shares;
    for (std::size_t k = 0; k < layout.cameras.size(); ++k) {
      const JointLayout::Camera& camera = layout.cameras[k];
      Share share;
      share.position = squares.segment<3>(camera.poseAt()).sum();
      share.turn = squares.segment<3>(camera.poseAt() + 3).sum();
      share.board = squares.segment<6>(layout.board_at).sum();
      for (std::size_t p = 0; p < camera.free.size(); ++p) {
        const double part = squares[camera.at + static_cast<int>(p)];
        (camera.free[p] < 2 ? share.focal : camera.free[p] < 4 ? share.center : share.distortion) += part;
      }
      shares.push_back(share);
      const double own = share.position + share.turn + share.focal + share.center + share.distortion;
      if (own > most) {
        most = own;
        worst = k;
      }
    }
    open.sentence = sentenceOf(problem, worst, shares[worst]);
    out.push_back(std::move(open));
  }
  return out;
}

std::vector<bool> undetermined(const JointProblem& problem, const JointState& state,
                               const Eigen::MatrixXd& covariance) {
  const JointLayout& layout = problem.layout();
  const Eigen::VectorXd scales = problem.scales(state);
  std::vector<bool> out(static_cast<std::size_t>(layout.size), false);
  for (const int i : judged(layout)) {
    const double sigma = std::sqrt(std::max(0.0, covariance(i, i)));
    out[static_cast<std::size_t>(i)] = !(sigma <= problem.options().undetermined_share * scales[i]);
  }
  for (std::size_t k = 0; k < layout.cameras.size(); ++k) {
    if (!problem.options().streams[k].prior) continue;
    for (std::size_t p = 0; p < layout.cameras[k].free.size(); ++p) {
      out[static_cast<std::size_t>(layout.cameras[k].at) + p] = false;
    }
  }
  return out;
}

}  // namespace servocal::calib
