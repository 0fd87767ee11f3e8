// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/camera_model.h"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "calib_scene.h"
#include "servocal/core/board_spec.h"

namespace servocal {
namespace {

/// A strong barrel lens, as of a wide-angle camera.
CameraModel wideCamera() {
  CameraModel camera = CameraModel::fromFieldOfView(640, 480, 1.5);
  camera.parameters << 343.0, 344.0, 321.0, 238.0, -0.28, 0.09, 0.001, -0.0015, -0.008;
  return camera;
}

std::vector<CameraModel> cameras() { return {test::hdCamera(), test::rationalCamera(), wideCamera()}; }

/// Points seen all over the image.
std::vector<Eigen::Vector3d> pointsInView(const CameraModel& camera) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::vector<Eigen::Vector3d> points;
  while (points.size() < 300) {
    const double z = 0.3 + 2 * unit(random);
    const Eigen::Vector3d point(z * (3 * unit(random) - 1.5), z * (2 * unit(random) - 1), z);
    const auto pixel = camera.project(point);
    if (pixel && camera.contains(*pixel)) points.push_back(point);
  }
  return points;
}

// OpenCV's projectPoints is the definition of the model.
TEST(CameraModel, ProjectsAsOpenCvDoes) {
  for (const CameraModel& camera : cameras()) {
    cv::Matx33d matrix(camera.fx(), 0, camera.cx(), 0, camera.fy(), camera.cy(), 0, 0, 1);
    std::vector<double> distortion(camera.parameters.data() + 4,
                                   camera.parameters.data() + camera.parameters.size());
    for (const Eigen::Vector3d& point : pointsInView(camera)) {
      std::vector<cv::Point2d> reference;
      cv::projectPoints(std::vector<cv::Point3d>{{point.x(), point.y(), point.z()}}, cv::Vec3d(0, 0, 0),
                        cv::Vec3d(0, 0, 0), matrix, distortion, reference);
      const auto pixel = camera.project(point);
      ASSERT_TRUE(pixel.has_value());
      EXPECT_NEAR(pixel->x(), reference[0].x, 1e-9);
      EXPECT_NEAR(pixel->y(), reference[0].y, 1e-9);
    }
  }
}

TEST(CameraModel, DerivativesAgreeWithDifferences) {
  for (const CameraModel& camera : cameras()) {
    for (const Eigen::Vector3d& point : pointsInView(camera)) {
      ProjectionJacobian jacobian;
      const auto pixel = camera.project(point, jacobian);
      ASSERT_TRUE(pixel.has_value());
      EXPECT_EQ((*pixel - *camera.project(point)).norm(), 0.0);
      for (int i = 0; i < 3; ++i) {
        const double h = 1e-6;
        Eigen::Vector3d plus = point, minus = point;
        plus[i] += h;
        minus[i] -= h;
        const Eigen::Vector2d difference = (*camera.project(plus) - *camera.project(minus)) / (2 * h);
        EXPECT_LT((jacobian.point.col(i) - difference).norm(), 1e-6 * (1 + jacobian.point.norm()));
      }
      ASSERT_EQ(jacobian.parameters.cols(), camera.parameters.size());
      for (int i = 0; i < camera.parameters.size(); ++i) {
        const double h = i < 4 ? 1e-3 : 1e-6;
        CameraModel plus = camera, minus = camera;
        plus.parameters[i] += h;
        minus.parameters[i] -= h;
        const Eigen::Vector2d difference = (*plus.project(point) - *minus.project(point)) / (2 * h);
        EXPECT_LT((jacobian.parameters.col(i) - difference).norm(), 1e-6 * (1 + jacobian.parameters.col(i).norm()))
            << parameterNames(camera.lens)[i];
      }
    }
  }
}

TEST(CameraModel, UnprojectUndoesProject) {
  for (const CameraModel& camera : cameras()) {
    for (const Eigen::Vector3d& point : pointsInView(camera)) {
      const auto ray = camera.unproject(*camera.project(point));
      ASSERT_TRUE(ray.has_value());
      EXPECT_LT((*ray - point.hnormalized()).norm(), 1e-10);
    }
    for (const double u : {0.0, 0.5, 1.0}) {  // every corner and edge of the image
      for (const double v : {0.0, 0.5, 1.0}) {
        const Eigen::Vector2d pixel(u * (camera.width_px - 1), v * (camera.height_px - 1));
        const auto ray = camera.unproject(pixel);
        ASSERT_TRUE(ray.has_value()) << pixel.transpose();
        EXPECT_LT((*camera.project(ray->homogeneous()) - pixel).norm(), 1e-7);
      }
    }
  }
}

TEST(CameraModel, DoesNotSeeBehindItself) {
  const CameraModel camera = test::hdCamera();
  EXPECT_FALSE(camera.project({0, 0, -1}).has_value());
  EXPECT_FALSE(camera.project({0, 0, 0}).has_value());
  EXPECT_FALSE(camera.project({0.1, 0.1, 1e-7}).has_value());
  EXPECT_FALSE(camera.project({0, 0, NAN}).has_value());
  EXPECT_TRUE(camera.project({0, 0, 1e-3}).has_value());
}

// With k1 = -0.3 alone the distorted radius grows until r = 1/sqrt(0.9) = 1.054 and then folds back: the ray
// at r = 1.3 would land on the pixel of another at r = 0.76.
TEST(CameraModel, RefusesRaysBeyondTheFold) {
  for (const LensModel lens : {LensModel::kPlumbBob, LensModel::kRational}) {
    CameraModel camera = CameraModel::fromFieldOfView(640, 480, 1.5, lens);
    camera.parameters[4] = -0.3;
    const double fold = 1 / std::sqrt(0.9);
    EXPECT_TRUE(camera.project({0.99 * fold, 0, 1}).has_value());
    EXPECT_FALSE(camera.project({1.01 * fold, 0, 1}).has_value());
    EXPECT_FALSE(camera.project({0, 1.3, 1}).has_value());
    EXPECT_FALSE(camera.project({1.0, 1.0, 1}).has_value());
    // The largest distorted radius is 2/3 of the fold's; no ray lands beyond.
    const double edge_px = camera.fx() * fold * 2 / 3;
    EXPECT_TRUE(camera.unproject({camera.cx() + 0.999 * edge_px, camera.cy()}).has_value());
    EXPECT_FALSE(camera.unproject({camera.cx() + 1.001 * edge_px, camera.cy()}).has_value());
    const auto ray = camera.unproject({camera.cx() + 0.98 * edge_px, camera.cy()});
    ASSERT_TRUE(ray.has_value());
    EXPECT_LT(ray->x(), fold);
  }
}

// A lens that folds and unfolds again: k1 < 0 < k2. The region beyond is not the image.
TEST(CameraModel, RefusesRaysBeyondTheFoldThoughItGrowsAgain) {
  CameraModel camera = CameraModel::fromFieldOfView(640, 480, 1.5);
  camera.parameters[4] = -0.5;
  camera.parameters[5] = 0.1;  // derivative 1 - 1.5 s + 0.5 s^2: negative for 1 < s < 2
  EXPECT_TRUE(camera.project({0.95, 0, 1}).has_value());
  EXPECT_FALSE(camera.project({1.2, 0, 1}).has_value());
  EXPECT_FALSE(camera.project({1.8, 0, 1}).has_value());
}

TEST(CameraModel, RationalDenominatorMustStayPositive) {
  CameraModel camera = CameraModel::fromFieldOfView(640, 480, 1.5, LensModel::kRational);
  camera.parameters[9] = -0.8;
  EXPECT_TRUE(camera.project({0.3, 0, 1}).has_value());
  EXPECT_FALSE(camera.project({1.2, 0, 1}).has_value());  // 1 - 0.8 * 1.44 < 0
}

TEST(CameraModel, FromFieldOfView) {
  const CameraModel camera = CameraModel::fromFieldOfView(1920, 1080, M_PI / 2);
  EXPECT_NEAR(camera.fx(), 960, 1e-9);
  EXPECT_EQ(camera.fx(), camera.fy());
  EXPECT_EQ(camera.cx(), 959.5);
  EXPECT_EQ(camera.cy(), 539.5);
  EXPECT_EQ(camera.parameters.size(), 9);
  EXPECT_THROW((void)CameraModel::fromFieldOfView(0, 10, 1), std::invalid_argument);
  EXPECT_THROW((void)CameraModel::fromFieldOfView(10, 10, 0), std::invalid_argument);
  EXPECT_THROW((void)CameraModel::fromFieldOfView(10, 10, M_PI), std::invalid_argument);
  EXPECT_THROW((void)CameraModel::fromFieldOfView(10, 10, NAN), std::invalid_argument);
}

TEST(CameraModel, ContainsItsPixels) {
  const CameraModel camera = CameraModel::fromFieldOfView(640, 480, 1.0);
  EXPECT_TRUE(camera.contains({0, 0}));
  EXPECT_TRUE(camera.contains({639, 479}));
  EXPECT_FALSE(camera.contains({639.1, 479}));
  EXPECT_FALSE(camera.contains({-0.1, 3}));
  EXPECT_FALSE(camera.contains({4, 100}, 5));
  EXPECT_FALSE(camera.contains({NAN, 100}));
}

TEST(CameraModel, NamesEveryParameter) {
  for (const LensModel lens : {LensModel::kPlumbBob, LensModel::kRational}) {
    EXPECT_EQ(static_cast<int>(parameterNames(lens).size()), parameterCount(lens));
  }
  EXPECT_STREQ(toString(LensModel::kRational), "rational_polynomial");
}

TEST(BoardSpec, NumbersCornersRowByRowAboutTheCentre) {
  const BoardSpec board;  // 7 x 5 squares of 30 mm
  EXPECT_EQ(board.cornerCount(), 24);
  EXPECT_LT((board.corner(0) - Eigen::Vector3d(-0.075, -0.045, 0)).norm(), 1e-15);
  EXPECT_LT((board.corner(1) - board.corner(0) - Eigen::Vector3d(0.03, 0, 0)).norm(), 1e-15);
  EXPECT_LT((board.corner(6) - board.corner(0) - Eigen::Vector3d(0, 0.03, 0)).norm(), 1e-15);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& corner : board.corners()) sum += corner;
  EXPECT_LT(sum.norm(), 1e-14);
}

TEST(BoardSpec, KnowsItsSymmetry) {
  BoardSpec board;
  EXPECT_EQ(board.symmetry(), 1);
  auto& squares = std::get<Checkerboard>(board.pattern);
  squares.hollow_corner = false;
  EXPECT_EQ(board.symmetry(), 2);  // 7 x 5
  squares.squares_y = 6;
  EXPECT_EQ(board.symmetry(), 1);  // half a turn swaps the colors
  squares.squares_x = 8;
  EXPECT_EQ(board.symmetry(), 2);
  squares.squares_x = squares.squares_y = 7;
  EXPECT_EQ(board.symmetry(), 4);
}

}  // namespace
}  // namespace servocal
