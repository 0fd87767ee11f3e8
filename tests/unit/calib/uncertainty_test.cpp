// SPDX-License-Identifier: GPL-3.0-or-later
// The maps against what happens to points when cameras are drawn from a solution's covariance.
#include "servocal/calib/uncertainty.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "joint_scene.h"

namespace servocal::calib {
namespace {

constexpr int kDraws = 3000;
constexpr double kShrunk = 0.1;      // Draws are of so many standard deviations: maps are first order.
constexpr double kTolerance = 0.06;  // 4.6 times what a standard deviation of so many draws errs by

/// A color and an infrared camera from few stops: uncertain enough that poses and lenses matter alike.
const JointSolution& solution() {
  static const JointSolution made = [] {
    const test::Cell cell = test::makeCell(6);
    std::mt19937_64 random(2);
    const auto stops = test::randomStops(cell, 30, random);
    return solveJoint(cell.board, test::observeAll(cell, stops, {0.2, 1e-4, 2.5e-4}, random))
        .solution.value();
  }();
  return made;
}

JointCamera moved(const JointCamera& camera, const Eigen::VectorXd& error) {
  JointCamera out = camera;
  for (std::size_t p = 0; p < camera.free.size(); ++p) {
    out.model.parameters[camera.free[p]] += error[camera.intrinsics_at + static_cast<Eigen::Index>(p)];
  }
  const Eigen::Vector3d shift = error.segment<3>(camera.pose_at), turn = error.segment<3>(camera.pose_at + 3);
  out.pose.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()) * camera.pose.linear();
  out.pose.translation() += shift;
  return out;
}

/// Both cameras, drawn from the covariance.
std::vector<std::vector<JointCamera>> drawn() {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd root = solution().covariance.llt().matrixL();
  std::vector<std::vector<JointCamera>> draws;
  for (int i = 0; i < kDraws; ++i) {
    Eigen::VectorXd error(root.cols());
    for (double& value : error) value = normal(random);
    error = kShrunk * (root * error);
    draws.emplace_back();
    for (const JointCamera& camera : solution().cameras) draws.back().push_back(moved(camera, error));
  }
  return draws;
}

template <int size>
Eigen::Matrix<double, size, size> covarianceOf(const std::vector<Eigen::Matrix<double, size, 1>>& errors) {
  Eigen::Matrix<double, size, size> sum = Eigen::Matrix<double, size, size>::Zero();
  for (const auto& error : errors) sum += error * error.transpose();
  return sum / (static_cast<double>(errors.size()) * kShrunk * kShrunk);
}

double worstSigma(const Eigen::Matrix2d& covariance) {
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(covariance).eigenvalues().maxCoeff());
}

Eigen::Vector2d pixelOf(const ProjectionMap& map, const CameraModel& model, std::size_t i) {
  const auto x = static_cast<int>(i) % map.cells_x, y = static_cast<int>(i) / map.cells_x;
  return {x * (model.width_px - 1.0) / (map.cells_x - 1), y * (model.height_px - 1.0) / (map.cells_y - 1)};
}

Eigen::Vector3d rayOf(const CameraModel& model, const Eigen::Vector2d& pixel) {
  const Eigen::Vector2d plane = model.unproject(pixel).value();
  return {plane.x(), plane.y(), 1.0};
}

TEST(ProjectionMap, IsTheSpreadOfAPointThatStandsInTheBase) {
  const auto draws = drawn();
  for (std::size_t k = 0; k < 2; ++k) {
    const JointCamera& camera = solution().cameras[k];
    for (const std::optional<double> distance_m : {std::optional<double>(0.6), std::optional<double>()}) {
      const ProjectionMap map = projectionMap(solution(), camera, Anchor::kBase, distance_m, 5, 3);
      ASSERT_EQ(map.sigma_px.size(), 15u);
      double worst = 0;
      for (std::size_t i = 0; i < map.sigma_px.size(); ++i) {
        // A star is a point so far that the camera's displacement does not show.
        const Eigen::Vector3d point_c =
            distance_m.value_or(1e6) * rayOf(camera.model, pixelOf(map, camera.model, i));
        const Eigen::Vector3d point_l = camera.pose * point_c;
        std::vector<Eigen::Vector2d> errors;
        for (const auto& draw : draws) {
          errors.push_back(draw[k].model.project(draw[k].pose.inverse() * point_l).value() -
                           camera.model.project(point_c).value());
        }
        const double spread_px = worstSigma(covarianceOf<2>(errors));
        EXPECT_NEAR(map.sigma_px[i], spread_px, kTolerance * spread_px) << k << ' ' << i;
        worst = std::max(worst, spread_px);
      }
      EXPECT_NEAR(map.worst_px, worst, kTolerance * worst);
    }
  }
}

// Of the intrinsics alone, once a rotation of the camera has taken up what it can.
TEST(ProjectionMap, OfIntrinsicsLeavesOutWhatARotationHides) {
  const auto draws = drawn();
  const JointCamera& camera = solution().cameras[0];
  const ProjectionMap map = projectionMap(solution(), camera, Anchor::kIntrinsics, std::nullopt, 5, 3);
  std::vector<std::vector<Eigen::Vector2d>> errors(map.sigma_px.size());
  for (const auto& draw : draws) {
    Eigen::MatrixXd by_turn(2 * errors.size(), 3);
    Eigen::VectorXd off(2 * errors.size());
    for (std::size_t i = 0; i < errors.size(); ++i) {
      const Eigen::Vector2d pixel = pixelOf(map, camera.model, i);
      const Eigen::Vector3d ray = rayOf(camera.model, pixel);
      off.segment<2>(2 * static_cast<Eigen::Index>(i)) = draw[0].model.project(ray).value() - pixel;
      for (int axis = 0; axis < 3; ++axis) {
        const Eigen::AngleAxisd turn(1e-6, Eigen::Vector3d::Unit(axis));
        by_turn.block<2, 1>(2 * static_cast<Eigen::Index>(i), axis) =
            (camera.model.project(turn * ray).value() - pixel) / 1e-6;
      }
    }
    const Eigen::VectorXd turn = by_turn.colPivHouseholderQr().solve(off);
    const Eigen::VectorXd left = off - by_turn * turn;
    for (std::size_t i = 0; i < errors.size(); ++i) {
      errors[i].push_back(left.segment<2>(2 * static_cast<Eigen::Index>(i)));
    }
  }
  for (std::size_t i = 0; i < errors.size(); ++i) {
    const double spread_px = worstSigma(covarianceOf<2>(errors[i]));
    EXPECT_NEAR(map.sigma_px[i], spread_px, kTolerance * spread_px) << i;
  }
  const ProjectionMap in_base = projectionMap(solution(), camera, Anchor::kBase, std::nullopt, 5, 3);
  EXPECT_LT(map.rms_px, in_base.rms_px);
}

/// The point that a camera that is a little off makes of what `camera` sees at a point, depth along the axis
/// exact.
Eigen::Vector3d measured(const JointCamera& camera, const JointCamera& believed,
                         const Eigen::Vector3d& point_l) {
  const Eigen::Vector3d point_c = camera.pose.inverse() * point_l;
  return believed.pose * (point_c.z() * rayOf(believed.model, camera.model.project(point_c).value()));
}

Eigen::Vector3d placeOf(const WorkspaceMap& map, const Box& box, std::size_t i) {
  const auto at = static_cast<int>(i);
  const Eigen::Vector3d share(at % map.cells_x, at / map.cells_x % map.cells_y,
                              at / (map.cells_x * map.cells_y));
  return box.min_m + (share / (map.cells_x - 1.0)).cwiseProduct(box.max_m - box.min_m);
}

const Box kBox{"", {0.35, -0.2, 0.3}, {0.75, 0.2, 0.6}};

TEST(WorkspaceMap, IsTheSpreadOfMeasuredPoints) {
  const auto draws = drawn();
  const JointCamera& camera = solution().cameras[0];
  const WorkspaceMap map = workspaceMap(solution(), camera, kBox, 4);
  int seen = 0;
  for (std::size_t i = 0; i < map.sigma_m.size(); ++i) {
    const Eigen::Vector3d point_l = placeOf(map, kBox, i), point_c = camera.pose.inverse() * point_l;
    const auto pixel = camera.model.project(point_c);
    const bool in_sight = pixel && camera.model.contains(*pixel);
    ASSERT_EQ(in_sight, std::isfinite(map.sigma_m[i]));
    if (!in_sight) continue;
    ++seen;
    std::vector<Eigen::Vector3d> errors;
    for (const auto& draw : draws) errors.emplace_back(measured(camera, draw[0], point_l) - point_l);
    const double spread_m = std::sqrt(covarianceOf<3>(errors).trace());
    EXPECT_NEAR(map.sigma_m[i], spread_m, kTolerance * spread_m) << i;
  }
  EXPECT_EQ(map.seen, seen);
  EXPECT_GT(seen, 10);
}

TEST(DisagreementMap, IsTheSpreadBetweenTwoCameras) {
  const auto draws = drawn();
  const JointCamera &first = solution().cameras[0], &second = solution().cameras[1];
  const WorkspaceMap map = disagreementMap(solution(), first, second, kBox, 4);
  int seen = 0;
  for (std::size_t i = 0; i < map.sigma_m.size(); ++i) {
    if (!std::isfinite(map.sigma_m[i])) continue;
    ++seen;
    const Eigen::Vector3d point_l = placeOf(map, kBox, i);
    std::vector<Eigen::Vector3d> errors;
    for (const auto& draw : draws) {
      errors.emplace_back(measured(first, draw[0], point_l) - measured(second, draw[1], point_l));
    }
    const double spread_m = std::sqrt(covarianceOf<3>(errors).trace());
    EXPECT_NEAR(map.sigma_m[i], spread_m, kTolerance * spread_m) << i;
  }
  EXPECT_GT(seen, 10);
}

TEST(CameraPairOf, HasTheCovarianceOfTheDraws) {
  const auto draws = drawn();
  const CameraPair pair = cameraPairOf(solution(), solution().cameras[0], solution().cameras[1]);
  std::vector<Eigen::Matrix<double, 6, 1>> errors;
  for (const auto& draw : draws) {
    const Eigen::Isometry3d apart = draw[0].pose.inverse() * draw[1].pose;
    errors.emplace_back();
    errors.back() << apart.translation() - pair.first_by_second.translation(),
        Pose<Color, Color>(Eigen::Matrix3d(apart.linear() * pair.first_by_second.linear().transpose()),
                           {0, 0, 0})
            .rotationVector();
  }
  const Eigen::Matrix<double, 6, 1> spread = covarianceOf<6>(errors).diagonal().cwiseSqrt();
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(std::sqrt(pair.covariance(i, i)), spread[i], kTolerance * spread[i]) << i;
  }
}

}  // namespace
}  // namespace servocal::calib
