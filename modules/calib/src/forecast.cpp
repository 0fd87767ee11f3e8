// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/calib/forecast.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "joint_prediction.h"
#include "joint_problem.h"
#include "map_rows.h"

namespace servocal::calib {
namespace {

constexpr double kLeastCornerSigmaPx = 0.02;
constexpr double kCounts = 0.98;  // Share of an aim's variance that its columns hold.
constexpr double kReachedWeight = 0.1;
constexpr int kImageCells = 9, kWorkspaceCells = 5;

/// Four corners with the second moments of them all, as nearly as the pattern has them.
std::vector<int> representatives(const BoardSpec& board) {
  const std::vector<Eigen::Vector3d> corners = board.corners();
  Eigen::Vector2d middle = Eigen::Vector2d::Zero(), spread = Eigen::Vector2d::Zero();
  for (const Eigen::Vector3d& corner : corners)
    middle += corner.head<2>() / static_cast<double>(corners.size());
  for (const Eigen::Vector3d& corner : corners) {
    spread += (corner.head<2>() - middle).cwiseAbs2() / static_cast<double>(corners.size());
  }
  std::vector<int> ids;
  for (const double x : {-1.0, 1.0}) {
    for (const double y : {-1.0, 1.0}) {
      const Eigen::Vector2d wanted = middle + spread.cwiseSqrt().cwiseProduct(Eigen::Vector2d(x, y));
      const auto nearest =
          std::min_element(corners.begin(), corners.end(), [&](const auto& a, const auto& b) {
            return (a.template head<2>() - wanted).norm() < (b.template head<2>() - wanted).norm();
          });
      ids.push_back(static_cast<int>(nearest - corners.begin()));
    }
  }
  return ids;
}

/// Places whose uncertainty counts: of each, how the shared parameters move it.
struct Places {
  std::vector<Eigen::MatrixXd> rows;
  double worst_sigma = 0.0;  // of all, in the worst direction (pixels) or by length (points)
};

/// R with R^T R the weighted mean of P^T P over the rows P; each weighs as much as it is uncertain now, so
/// that the worst counts most.
Eigen::MatrixXd meanRoot(const std::vector<Eigen::MatrixXd>& rows, const Eigen::MatrixXd& covariance) {
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(covariance.rows(), covariance.cols());
  double weights = 0.0;
  for (const Eigen::MatrixXd& row : rows) {
    const double weight = (row * covariance * row.transpose()).trace();
    mean += weight * row.transpose() * row;
    weights += weight;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(mean / weights);
  return eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal() * eigen.eigenvectors().transpose();
}

Places imagePlaces(const JointCamera& camera, const Eigen::MatrixXd& covariance, double range_m) {
  Places places;
  for (const bool at_infinity : {true, false}) {
    for (const auto& seen : grid(camera, kImageCells, kImageCells, at_infinity ? 1.0 : range_m)) {
      if (!seen) continue;
      Eigen::MatrixXd row(2, static_cast<Eigen::Index>(camera.free.size()) + 6);
      row << byIntrinsics(camera, seen->by), byPose(camera, *seen, at_infinity);
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> spread(row * covariance * row.transpose());
      places.worst_sigma = std::max(places.worst_sigma, std::sqrt(spread.eigenvalues()[1]));
      places.rows.push_back(std::move(row));
    }
  }
  return places;
}

Places workspacePlaces(const JointCamera& camera, const Eigen::MatrixXd& covariance, const Box& box) {
  Places places;
  for (int i = 0; i < kWorkspaceCells * kWorkspaceCells * kWorkspaceCells; ++i) {
    const Eigen::Vector3d share = Eigen::Vector3d(i % kWorkspaceCells, i / kWorkspaceCells % kWorkspaceCells,
                                                  i / (kWorkspaceCells * kWorkspaceCells)) /
                                  (kWorkspaceCells - 1.0);
    if (auto row = byBackProjection(camera, box.min_m + share.cwiseProduct(box.max_m - box.min_m))) {
      places.worst_sigma =
          std::max(places.worst_sigma, std::sqrt((*row * covariance * row->transpose()).trace()));
      places.rows.push_back(*std::move(row));
    }
  }
  return places;
}

/// As many rows that tell the same: the corners' noise is that of one, so turning all rows together changes nothing.
Eigen::MatrixXd condensed(const Eigen::MatrixXd& jacobian, Eigen::Index rows) {
  if (jacobian.rows() <= rows) return jacobian;
  const Eigen::Index telling = std::min(rows, jacobian.cols());
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(jacobian);
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(rows, jacobian.cols());
  out.topRows(telling) = Eigen::MatrixXd(qr.matrixQR().topRows(telling).triangularView<Eigen::Upper>());
  return out;
}

}  // namespace

/// Whitened rows of one stop, and the covariance of its own error and of its corners.
struct Forecast::Rows {
  struct Look {
    Eigen::Index own_at = 0;
    Eigen::MatrixXd by_own;
  };
  std::vector<Look> looks;   // All of the same size, one below the other.
  Eigen::MatrixXd by_board;  // Board's pose and shape, of all looks.
  Eigen::MatrixXd noise;

  Eigen::Index rowsOfLook() const { return looks.front().by_own.rows(); }
  /// The rows times a matrix over the shared parameters.
  Eigen::MatrixXd times(const Eigen::MatrixXd& shared, Eigen::Index board_at) const {
    Eigen::MatrixXd out = by_board * shared.middleRows(board_at, by_board.cols());
    Eigen::Index at = 0;
    for (const Look& look : looks) {
      out.middleRows(at, rowsOfLook()).noalias() +=
          look.by_own * shared.middleRows(look.own_at, look.by_own.cols());
      at += rowsOfLook();
    }
    return out;
  }
  /// Covariance of what the stop will show: the prediction's, the stop's error, the corners' noise. Only the
  /// lower triangle.
  Eigen::MatrixXd spread(const Eigen::MatrixXd& covariance, Eigen::Index board_at) const {
    const Eigen::Index board = by_board.cols(), rows = rowsOfLook();
    Eigen::MatrixXd out = noise;
    out.noalias() += by_board * covariance.block(board_at, board_at, board, board) * by_board.transpose();
    Eigen::Index at = 0;
    for (const Look& look : looks) {
      const Eigen::Index own = look.by_own.cols();
      const Eigen::MatrixXd with_board =
          look.by_own * covariance.block(look.own_at, board_at, own, board) * by_board.transpose();
      out.middleRows(at, rows) += with_board;
      out.middleCols(at, rows) += with_board.transpose();
      Eigen::Index other_at = 0;
      for (const Look* other = looks.data(); other <= &look; ++other) {
        out.block(at, other_at, rows, rows).noalias() +=
            look.by_own * covariance.block(look.own_at, other->own_at, own, other->by_own.cols()) *
            other->by_own.transpose();
        other_at += rows;
      }
      at += rows;
    }
    return out;
  }
};

Forecast::Forecast(const BoardSpec& board, const JointSolution& solution, const ForecastOptions& options)
    : board_(board), solution_(solution) {
  if (!solution.covariance.allFinite())
    throw std::invalid_argument("a forecast needs a covariance that is finite");
  if (solution.robot_terms.size() > 0)
    throw std::invalid_argument("a forecast knows no systematic errors of the arm");
  const auto aimAt = [this](std::size_t camera, const Eigen::MatrixXd& covariance, const Places& places,
                            double goal) {
    if (places.rows.empty()) return;  // No point of the workspace is seen.
    targets_.push_back(
        {camera, meanRoot(places.rows, covariance), places.worst_sigma > goal ? 1.0 : kReachedWeight});
  };
  for (std::size_t i = 0; i < solution.cameras.size(); ++i) {
    const JointCamera& camera = solution.cameras[i];
    const auto size = static_cast<Eigen::Index>(camera.free.size()) + 6;
    const Eigen::MatrixXd own =
        solution.covariance.block(camera.intrinsics_at, camera.intrinsics_at, size, size);
    aimAt(i, own, imagePlaces(camera, own, options.range_m), options.projection_goal_px);
    aimAt(i, own, workspacePlaces(camera, own, options.workspace), options.point_goal_m);
  }
  setAims();
}

void Forecast::setAims() {
  aims_.clear();
  const Eigen::MatrixXd& covariance = solution_.covariance;
  std::vector<Eigen::MatrixXd> by_shared;
  Eigen::Index all = 0;
  for (const Target& target : targets_) {
    const Eigen::MatrixXd& root = target.root;
    const Eigen::Index at = solution_.cameras[target.camera].intrinsics_at, size = root.cols();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(root * covariance.block(at, at, size, size) *
                                                               root.transpose());
    // The largest columns first make up nearly all of it: few are left to be carried along.
    Eigen::Index columns = 0;
    for (double held = 0.0; columns < size && held < kCounts * eigen.eigenvalues().sum(); ++columns) {
      held += eigen.eigenvalues()[size - 1 - columns];
    }
    const Eigen::MatrixXd counting = root.transpose() * eigen.eigenvectors().rightCols(columns);
    by_shared.emplace_back(covariance.middleCols(at, size) * counting);
    aims_.push_back({columns, eigen.eigenvalues().sum(), target.weight});
    all += columns;
  }
  aims_by_shared_.resize(covariance.rows(), all);
  Eigen::Index at = 0;
  for (const Eigen::MatrixXd& aim : by_shared) {
    aims_by_shared_.middleCols(at, aim.cols()) = aim;
    at += aim.cols();
  }
}

std::vector<Forecast::Rows> Forecast::rowsOf(const std::vector<PlannedStop>& planned,
                                             const std::vector<int>& corner_ids) const {
  BoardDetection detection;
  for (const int id : corner_ids) {
    detection.corners.push_back({id, Eigen::Vector2d::Zero(), Eigen::Matrix2d::Identity()});
  }
  const double counts_for =
      static_cast<double>(board_.corners().size()) / static_cast<double>(detection.corners.size());
  JointPrediction prediction(board_, {}, solution_);
  JointProblem& problem = prediction.problem();
  std::vector<JointStop> stops;
  for (const PlannedStop& stop : planned) stops.push_back({nullptr, stop.bMe.isometry(), {}});
  problem.setStops(std::move(stops));
  JointState state = prediction.state();
  state.corrections.assign(planned.size(), Vector6d::Zero());

  const Eigen::Index common = 6 + problem.layout().shapeSize();
  Eigen::Index rows = 0;
  for (const JointLayout::Camera& camera : problem.layout().cameras) {
    rows = std::max(rows, camera.size() + common + 6);
  }
  rows = std::min(rows, static_cast<Eigen::Index>(2 * detection.corners.size()));
  Vector6d robot;
  robot << Eigen::Vector3d::Constant(std::pow(solution_.robot.sigma_m, 2)),
      Eigen::Vector3d::Constant(std::pow(solution_.robot.sigma_rad, 2));
  std::vector<Rows> out;
  for (std::size_t i = 0; i < planned.size(); ++i) {
    Rows seen_at;
    const auto most = static_cast<Eigen::Index>(planned[i].looks.size()) * rows;
    seen_at.by_board.resize(most, common);
    Eigen::MatrixXd by_stop(most, 6);
    Eigen::Index at = 0;
    for (const PlannedStop::Look& look : planned[i].looks) {
      // One that is seen with a probability brings its share of the information.
      const JointCamera& camera = solution_.cameras[look.camera];
      const double sigma_px = std::max(kLeastCornerSigmaPx, camera.rms_px / std::sqrt(2.0));
      const double weight = camera.corner_scale * std::sqrt(counts_for * look.probability) / sigma_px;
      const JointView view{
          i, look.camera, &detection, 0,
          std::vector<Eigen::Matrix2d>(detection.corners.size(), weight * Eigen::Matrix2d::Identity())};
      const auto seen = problem.residual(state, view);
      if (!seen) continue;
      const JointLayout::Camera& layout = problem.layout().cameras[look.camera];
      const Eigen::MatrixXd jacobian = condensed(seen->jacobian, rows);
      seen_at.looks.push_back({layout.at, jacobian.leftCols(layout.size())});
      seen_at.by_board.middleRows(at, rows) = jacobian.middleCols(layout.size(), common);
      by_stop.middleRows(at, rows) = jacobian.rightCols<6>();
      at += rows;
    }
    seen_at.by_board.conservativeResize(at, common);
    by_stop.conservativeResize(at, 6);
    seen_at.noise = by_stop * robot.asDiagonal() * by_stop.transpose();
    seen_at.noise.diagonal().array() += 1.0;
    out.push_back(std::move(seen_at));
  }
  return out;
}

std::vector<double> Forecast::gains(const std::vector<PlannedStop>& stops) const {
  std::vector<double> gains;
  for (const Rows& rows : rowsOf(stops, representatives(board_))) {
    gains.push_back(0.0);
    if (rows.looks.empty()) continue;
    const Eigen::LLT<Eigen::MatrixXd> spread(rows.spread(solution_.covariance, solution_.board_at));
    Eigen::MatrixXd taken = rows.times(aims_by_shared_, solution_.board_at);
    spread.matrixL().solveInPlace(taken);
    Eigen::Index at = 0;
    for (const Aim& aim : aims_) {
      const double less = taken.middleCols(at, aim.columns).squaredNorm();
      gains.back() -= aim.weight * std::log(std::max(1e-6, 1.0 - less / aim.variance));
      at += aim.columns;
    }
  }
  return gains;
}

void Forecast::add(const PlannedStop& stop) {
  std::vector<int> all(board_.corners().size());
  std::iota(all.begin(), all.end(), 0);
  const Rows rows = rowsOf({stop}, all).front();
  if (rows.looks.empty()) return;
  const Eigen::LLT<Eigen::MatrixXd> spread(rows.spread(solution_.covariance, solution_.board_at));
  Eigen::MatrixXd taken = rows.times(solution_.covariance, solution_.board_at);
  spread.matrixL().solveInPlace(taken);
  solution_.covariance -= taken.transpose() * taken;
  setAims();
}

}  // namespace servocal::calib
