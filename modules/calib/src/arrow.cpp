// SPDX-License-Identifier: GPL-3.0-or-later
#include "arrow.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <limits>

namespace servocal::calib {
namespace {

Eigen::VectorXd inverseRootDiagonal(const Eigen::MatrixXd& matrix) {
  return matrix.diagonal().cwiseMax(std::numeric_limits<double>::min()).cwiseSqrt().cwiseInverse();
}

}  // namespace

ArrowSystem::ArrowSystem(int shared_size, int block_count)
    : matrix(Eigen::MatrixXd::Zero(shared_size, shared_size)),
      gradient(Eigen::VectorXd::Zero(shared_size)),
      blocks(block_count) {
  for (Block& block : blocks) block.cross.setZero(shared_size, 6);
}

void ArrowSystem::add(int block, const Eigen::MatrixXd& jacobian, const Eigen::VectorXd& residual) {
  const Eigen::Index shared = gradient.size();
  const auto shared_columns = jacobian.leftCols(shared);
  const auto own_columns = jacobian.rightCols<6>();
  Block& own = blocks[block];
  matrix.noalias() += shared_columns.transpose() * shared_columns;
  gradient.noalias() += shared_columns.transpose() * residual;
  own.cross.noalias() += shared_columns.transpose() * own_columns;
  own.matrix.noalias() += own_columns.transpose() * own_columns;
  own.gradient.noalias() += own_columns.transpose() * residual;
  cost += residual.squaredNorm();
}

std::optional<ArrowStep> arrowStep(const ArrowSystem& system, double damping) {
  const double factor = 1.0 + damping;
  Eigen::MatrixXd reduced = system.matrix;
  reduced.diagonal() *= factor;
  Eigen::VectorXd right = -system.gradient;
  std::vector<Eigen::LLT<Matrix6d>> factors(system.blocks.size());
  for (std::size_t i = 0; i < system.blocks.size(); ++i) {
    const ArrowSystem::Block& block = system.blocks[i];
    Matrix6d own = block.matrix;
    own.diagonal() *= factor;
    factors[i].compute(own);
    if (factors[i].info() != Eigen::Success) return std::nullopt;
    const Eigen::Matrix<double, 6, Eigen::Dynamic> solved = factors[i].solve(block.cross.transpose());
    reduced.noalias() -= block.cross * solved;
    right.noalias() += solved.transpose() * block.gradient;
  }
  const Eigen::VectorXd scale = inverseRootDiagonal(reduced);
  const Eigen::LLT<Eigen::MatrixXd> cholesky(scale.asDiagonal() * reduced * scale.asDiagonal());
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  ArrowStep step;
  step.shared = scale.cwiseProduct(cholesky.solve(scale.cwiseProduct(right)));
  step.decrement = -step.shared.dot(system.gradient);
  step.blocks.resize(system.blocks.size());
  for (std::size_t i = 0; i < system.blocks.size(); ++i) {
    const ArrowSystem::Block& block = system.blocks[i];
    step.blocks[i] = -factors[i].solve(block.gradient + block.cross.transpose() * step.shared);
    step.decrement -= step.blocks[i].dot(block.gradient);
  }
  if (!step.shared.allFinite() || !std::isfinite(step.decrement)) return std::nullopt;
  return step;
}

Eigen::MatrixXd reducedMatrix(const ArrowSystem& system) {
  Eigen::MatrixXd reduced = system.matrix;
  for (const ArrowSystem::Block& block : system.blocks) {
    reduced.noalias() -= block.cross * block.matrix.ldlt().solve(block.cross.transpose());
  }
  return 0.5 * (reduced + reduced.transpose());
}

double symmetricCondition(const Eigen::MatrixXd& matrix) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(matrix, Eigen::EigenvaluesOnly);
  const double smallest = eigen.eigenvalues().minCoeff(), largest = eigen.eigenvalues().maxCoeff();
  return smallest > 0.0 ? largest / smallest : std::numeric_limits<double>::infinity();
}

double scaledCondition(const Eigen::MatrixXd& matrix) {
  const Eigen::VectorXd scale = inverseRootDiagonal(matrix);
  return symmetricCondition(scale.asDiagonal() * matrix * scale.asDiagonal());
}

Eigen::MatrixXd scaledInverse(const Eigen::MatrixXd& matrix) {
  const Eigen::VectorXd scale = inverseRootDiagonal(matrix);
  const Eigen::MatrixXd scaled = scale.asDiagonal() * matrix * scale.asDiagonal();
  const Eigen::MatrixXd inverse = scaled.ldlt().solve(Eigen::MatrixXd::Identity(matrix.rows(), matrix.cols()));
  return scale.asDiagonal() * (0.5 * (inverse + inverse.transpose())) * scale.asDiagonal();
}

}  // namespace servocal::calib
