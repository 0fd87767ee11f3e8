// SPDX-License-Identifier: GPL-3.0-or-later
// Rendered pixels against brute force, and the place of rendered corners against the truth.
#include <gtest/gtest.h>

#include <functional>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "background.h"
#include "default_sim.h"
#include "gray_renderer.h"
#include "sim_truth.h"

namespace servocal::sim {
namespace {

Lens testLens() {
  Random random(4, "test lens");
  return Lens::draw(SimulatedCameraConfig{}, 1920, 1080, random);
}

Light flatLight() {
  Light light;
  light.towards_c = {0.0, 0.0, -1.0};
  light.fall_per_px.setZero();
  return light;
}

SimulatedCameraConfig idealCamera() {
  SimulatedCameraConfig camera;
  camera.defocus_px = 0.0;
  camera.defocus_px_per_diopter = 0.0;
  camera.noise_gray = 0.0;
  return camera;
}

Eigen::Isometry3d boardPose(double x, double y, double z, double tilt, double roll) {
  Eigen::Isometry3d cMo = Eigen::Isometry3d::Identity();
  cMo.linear() = (Eigen::AngleAxisd(tilt, Eigen::Vector3d(0.6, 0.8, 0.0)) *
                  Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()))
                     .toRotationMatrix();
  cMo.translation() = Eigen::Vector3d(x, y, z);
  return cMo;
}

cv::Mat rendered(const Eigen::Isometry3d& cMo, const Light& light, const SimulatedCameraConfig& camera,
                 const BoardSpec& board = {}) {
  Random random(1, "test frame");
  const cv::Mat background = drawBackground(1920, 1080, /*clutter=*/false, random);
  GrayRenderer renderer(board, testLens(), light, Tones{}, camera, background);
  return renderer.render([&](double) { return cMo; }, {}, random);
}

/// 1 on white, 0 on black, -1 beside the plate; straight from BoardSpec's description.
double printedAt(const BoardSpec& spec, double x_m, double y_m) {
  const Checkerboard& board = *spec.as<Checkerboard>();
  const double u = x_m / board.square_size_m + 0.5 * board.squares_x;
  const double v = y_m / board.square_size_m + 0.5 * board.squares_y;
  const double margin = spec.margin_m / board.square_size_m;
  if (u < -margin || v < -margin || u > board.squares_x + margin || v > board.squares_y + margin) return -1;
  if (u < 0 || v < 0 || u >= board.squares_x || v >= board.squares_y) return 1;
  const int column = static_cast<int>(u), row = static_cast<int>(v);
  if ((column + row) % 2 == 1) return 1;
  const double half = 0.5 * board.hollow_inner_ratio;
  const bool inside = std::abs(u - 0.5) < half && std::abs(v - 0.5) < half;
  return column == 0 && row == 0 && board.hollow_corner && inside ? 1 : 0;
}

/// The same for a grid of tags, whose cells come from OpenCV's copy of the codes.
double printedAt(const TagGrid& grid, double margin_m, double x_m, double y_m) {
  static const cv::Ptr<cv::aruco::Dictionary> codes =
      cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11);
  const double pitch = grid.tag_size_m + grid.tag_gap_m;
  const double x = x_m + 0.5 * (grid.tags_x * pitch - grid.tag_gap_m);
  const double y = y_m + 0.5 * (grid.tags_y * pitch - grid.tag_gap_m);
  const double right = grid.tags_x * pitch - grid.tag_gap_m, low = grid.tags_y * pitch - grid.tag_gap_m;
  if (x < -margin_m || y < -margin_m || x > right + margin_m || y > low + margin_m) return -1;
  if (x < 0 || y < 0 || x >= right || y >= low) return 1;
  const int column = static_cast<int>(x / pitch), row = static_cast<int>(y / pitch);
  const double cell_m = grid.tag_size_m / 8;
  const int i = static_cast<int>((x - column * pitch) / cell_m),
            j = static_cast<int>((y - row * pitch) / cell_m);
  if (i >= 8 || j >= 8) return 1;
  if (i == 0 || j == 0 || i == 7 || j == 7) return 0;
  const int code = grid.first_id + (grid.tags_y - 1 - row) * grid.tags_x + column;  // From the lower left.
  const cv::Mat bits =
      cv::aruco::Dictionary::getBitsFromByteList(codes->bytesList.rowRange(code, code + 1), 6);
  return bits.at<uchar>(6 - j, 6 - i);  // OpenCV keeps these codes upside down.
}

// Sixteen by sixteen rays per pixel, each through OpenCV's undistortion: the slow, obvious way.
void compareWithBruteForce(const BoardSpec& board, const std::function<double(double, double)>& print_at,
                           double rms_gray) {
  const Lens lens = testLens();
  const cv::Matx33d matrix(lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1);
  const std::vector<double> distortion = {lens.k1, lens.k2, lens.p1, lens.p2, lens.k3};
  const cv::TermCriteria exact(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-9);
  for (const double roll : {0.0, 0.5}) {
    const Eigen::Isometry3d cMo = boardPose(-0.35, 0.12, 0.8, 0.5, roll);
    const Eigen::Isometry3d oMc = cMo.inverse();
    const cv::Mat image = rendered(cMo, flatLight(), idealCamera(), board);
    const Eigen::Vector2d first = lens.project(cMo * board.corner(0));
    const cv::Rect region(static_cast<int>(first.x()) - 40, static_cast<int>(first.y()) - 40, 90, 90);
    const int white = 255;  // Scaled below.
    std::vector<double> reference, actual;
    for (int v = region.y; v < region.y + region.height; ++v) {
      std::vector<cv::Point2d> samples, rays;
      for (int u = region.x; u < region.x + region.width; ++u) {
        for (int i = 0; i < 256; ++i) {
          samples.emplace_back(u + (i % 16 + 0.5) / 16 - 0.5, v + (i / 16 + 0.5) / 16 - 0.5);
        }
      }
      cv::undistortPoints(samples, rays, matrix, distortion, cv::noArray(), cv::noArray(), exact);
      for (int u = 0; u < region.width; ++u) {
        double sum = 0.0;
        bool on_plate = true;
        for (int i = 0; i < 256; ++i) {
          const cv::Point2d& ray = rays[u * 256 + i];
          const Eigen::Vector3d direction = oMc.linear() * Eigen::Vector3d(ray.x, ray.y, 1.0);
          const Eigen::Vector3d eye = oMc.translation();
          const Eigen::Vector3d hit = eye - direction * eye.z() / direction.z();
          const double print = print_at(hit.x(), hit.y());
          on_plate &= print >= 0.0;
          sum += print;
        }
        if (!on_plate) continue;
        reference.push_back(sum / 256);
        actual.push_back(image.at<std::uint8_t>(v, region.x + u));
      }
    }
    ASSERT_GT(reference.size(), 3000U);
    // Black and white as seen where the pixel has one color alone.
    double black = 0, bright = 0, blacks = 0, brights = 0;
    for (std::size_t i = 0; i < reference.size(); ++i) {
      if (reference[i] == 0.0) black += actual[i], ++blacks;
      if (reference[i] == 1.0) bright += actual[i], ++brights;
    }
    black /= blacks;
    bright /= brights;
    EXPECT_GT(bright - black, 0.4 * white);
    double sum = 0.0, worst = 0.0, misplaced = 0.0;
    for (std::size_t i = 0; i < reference.size(); ++i) {
      const double expected = black + (bright - black) * reference[i];
      sum += std::pow(actual[i] - expected, 2);
      worst = std::max(worst, std::abs(actual[i] - expected));
      if (i > 0) misplaced += std::pow(actual[i - 1] - expected, 2);
    }
    const double rms = std::sqrt(sum / reference.size());
    EXPECT_LT(rms, rms_gray) << "roll " << roll;
    EXPECT_LT(worst, 25.0) << "roll " << roll;
    // Negative control: one pixel beside, the same measure is far off.
    EXPECT_GT(std::sqrt(misplaced / reference.size()), 10.0 * rms);
  }
}

TEST(Rendering, MatchesBruteForce) {
  const BoardSpec board;
  compareWithBruteForce(
      board, [&](double x, double y) { return printedAt(board, x, y); }, 1.5);
}

TEST(Rendering, TagsMatchBruteForce) {
  TagGrid tags;
  tags.first_id = 100;
  const BoardSpec board{tags, 0.01};
  // A pixel is integrated as an upright box in board axes; only edges notice, and tags have many more.
  compareWithBruteForce(
      board, [&](double x, double y) { return printedAt(tags, board.margin_m, x, y); }, 2.5);
}

// No reference knows circles: the centre of mass of each disc's ink is where its centre is seen. A disc seen
// at a slant is not an ellipse about its centre; straight on it is.
TEST(Rendering, DiscsLieWhereTheirCentresAre) {
  const BoardSpec board{CircleGrid{4, 3, 0.04, 0.012, true, 1.5}, 0.02};
  const Eigen::Isometry3d cMo = boardPose(0.0, 0.0, 0.6, 0.0, 0.2);
  const cv::Mat image = rendered(cMo, flatLight(), idealCamera(), board);
  for (int id = 0; id < board.cornerCount(); ++id) {
    const Eigen::Vector2d centre = testLens().project(cMo * board.corner(id));
    const int radius = 20;
    const cv::Rect box(std::lround(centre.x()) - radius, std::lround(centre.y()) - radius, 2 * radius + 1,
                       2 * radius + 1);
    double sum = 0, x = 0, y = 0, white = 0;
    cv::Mat patch;
    image(box).convertTo(patch, CV_64F);
    cv::minMaxLoc(patch, nullptr, &white);
    for (int v = 0; v < patch.rows; ++v) {
      for (int u = 0; u < patch.cols; ++u) {
        const double ink = white - patch.at<double>(v, u);
        sum += ink, x += ink * (box.x + u), y += ink * (box.y + v);
      }
    }
    EXPECT_NEAR(x / sum, centre.x(), 0.1) << id;
    EXPECT_NEAR(y / sum, centre.y(), 0.1) << id;
  }
}

struct CornerErrors {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double rms_px = 0.0;  ///< Per axis.
};

CornerErrors cornerErrors(const cv::Mat& image, const std::vector<Eigen::Vector2d>& truth) {
  std::vector<cv::Point2f> found;
  for (const Eigen::Vector2d& corner : truth) found.emplace_back(corner.x(), corner.y());
  cv::cornerSubPix(image, found, cv::Size(5, 5), cv::Size(-1, -1),
                   cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 60, 1e-4));
  CornerErrors errors;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const Eigen::Vector2d error = Eigen::Vector2d(found[i].x, found[i].y) - truth[i];
    errors.mean += error / truth.size();
    errors.rms_px += error.squaredNorm() / (2.0 * truth.size());
  }
  errors.rms_px = std::sqrt(errors.rms_px);
  return errors;
}

std::vector<Eigen::Vector2d> trueCorners(const Eigen::Isometry3d& cMo) {
  std::vector<Eigen::Vector2d> corners;
  for (const Eigen::Vector3d& corner : BoardSpec{}.corners()) {
    corners.push_back(testLens().project(cMo * corner));
  }
  return corners;
}

TEST(Rendering, CornersAreWhereTheyShouldBe) {
  SimulatedCameraConfig camera = idealCamera();
  camera.defocus_px = SimulatedCameraConfig{}.defocus_px;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  int images = 0;
  for (const double roll : {0.0, 0.4, 1.2, 2.5}) {
    for (const auto& [x, y] : {std::pair{-0.31, -0.15}, {0.013, 0.027}, {0.4, 0.12}}) {
      const Eigen::Isometry3d cMo = boardPose(x, y, 0.7, 0.4, roll);
      const CornerErrors errors = cornerErrors(rendered(cMo, flatLight(), camera), trueCorners(cMo));
      EXPECT_LT(errors.rms_px, 0.05) << x << " " << y << " " << roll;
      mean += errors.mean;
      ++images;
    }
  }
  mean /= images;
  EXPECT_LT(mean.norm(), 0.02) << mean.transpose();
  // Negative control: the half pixel of the other pixel convention would show.
  const Eigen::Isometry3d cMo = boardPose(0.0, 0.0, 0.7, 0.4, 0.4);
  std::vector<Eigen::Vector2d> shifted = trueCorners(cMo);
  for (Eigen::Vector2d& corner : shifted) corner += Eigen::Vector2d(0.5, 0.5);
  EXPECT_GT(cornerErrors(rendered(cMo, flatLight(), camera), shifted).mean.norm(), 0.5);
}

TEST(Rendering, HollowSquareIsTheOneBeyondCornerZero) {
  const Eigen::Isometry3d cMo = boardPose(0.0, 0.0, 0.6, 0.2, 0.3);
  const BoardSpec board;
  const cv::Mat image = rendered(cMo, flatLight(), idealCamera());
  const auto grayAt = [&](const Eigen::Vector3d& point_o) {
    const Eigen::Vector2d pixel = testLens().project(cMo * point_o);
    return static_cast<int>(image.at<std::uint8_t>(std::lround(pixel.y()), std::lround(pixel.x())));
  };
  const double square = board.spacing();
  const Eigen::Vector3d outward(-0.5 * square, -0.5 * square, 0.0);
  EXPECT_GT(grayAt(board.corner(0) + outward), 150);
  EXPECT_LT(grayAt(board.corner(0) + 0.15 * outward), 60);
  EXPECT_LT(grayAt(board.corner(board.cornerCount() - 1) - outward), 60);
  BoardSpec plain;
  std::get<Checkerboard>(plain.pattern).hollow_corner = false;
  const cv::Mat solid = rendered(cMo, flatLight(), idealCamera(), plain);
  const Eigen::Vector2d centre = testLens().project(cMo * (board.corner(0) + outward));
  EXPECT_LT(solid.at<std::uint8_t>(std::lround(centre.y()), std::lround(centre.x())), 60);
}

TEST(Rendering, FromBehindTheBoardIsADarkPlate) {
  Eigen::Isometry3d cMo = boardPose(0.0, 0.0, 0.6, 0.0, 0.0);
  cMo.linear() = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const cv::Mat image = rendered(cMo, flatLight(), idealCamera());
  const cv::Mat plate = image(cv::Rect(960 - 100, 540 - 60, 200, 120));
  double low = 0.0, high = 0.0;
  cv::minMaxLoc(plate, &low, &high);
  EXPECT_LT(high, 60.0);
  EXPECT_LT(high - low, 3.0);
}

TEST(Rendering, OutsideTheImageOrBehindTheCameraThereIsNoBoard) {
  for (const Eigen::Isometry3d& cMo :
       {boardPose(3.0, 0.0, 0.6, 0.0, 0.0), boardPose(0.0, 0.0, -0.6, 0.0, 0.0),
        boardPose(0.0, 0.0, 0.03, 0.8, 0.0)}) {
    const cv::Mat image = rendered(cMo, flatLight(), idealCamera());
    double low = 0.0, high = 0.0;
    cv::minMaxLoc(image, &low, &high);
    EXPECT_EQ(low, high);
  }
  // Half in the image, the visible half is drawn.
  cv::Mat image = rendered(boardPose(0.0, -0.30, 0.6, 0.0, 0.0), flatLight(), idealCamera());
  double low = 0.0, high = 0.0;
  cv::minMaxLoc(image, &low, &high);
  EXPECT_GT(high - low, 150.0);
}

TEST(Rendering, HighlightFollowsTheBoardsNormal) {
  Light light = flatLight();
  light.specular = 0.35;
  light.towards_c = Eigen::Vector3d(0.0, -0.6, -0.8);
  const double mirror_tilt = 0.5 * std::atan2(0.6, 0.8);
  const auto brightnessAt = [&](double tilt) {
    Eigen::Isometry3d cMo = boardPose(0.0, 0.0, 0.6, 0.0, 0.0);
    cMo.linear() = Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitX()).toRotationMatrix();
    return cv::mean(rendered(cMo, light, idealCamera())(cv::Rect(860, 490, 200, 100)))[0];
  };
  // Tilted halfway to the light the board shines, tilted the other way it does not.
  const double difference = brightnessAt(mirror_tilt) - brightnessAt(-mirror_tilt);
  EXPECT_GT(std::abs(difference), 30.0);
}

// The noise has the stated size at mid gray, grows with the signal, and is fresh in every frame.
TEST(Rendering, NoiseIsAsConfigured) {
  SimulatedCameraConfig camera = idealCamera();
  camera.noise_gray = 7.0;
  Random wall_random(1, "test wall");
  GrayRenderer renderer(BoardSpec{}, testLens(), flatLight(), Tones{}, camera,
                        drawBackground(1920, 1080, /*clutter=*/false, wall_random));
  const Eigen::Isometry3d cMo = boardPose(0.0, 0.0, 0.6, 0.0, 0.0);
  Random random(1, "test frames");
  const cv::Mat first = renderer.render([&](double) { return cMo; }, {}, random);
  const cv::Mat second = renderer.render([&](double) { return cMo; }, {}, random);
  const auto deviation = [](const cv::Mat& image) {
    cv::Scalar mean, sigma;
    cv::meanStdDev(image, mean, sigma);
    return sigma[0];
  };
  const cv::Rect wall(100, 100, 400, 800);
  EXPECT_NEAR(deviation(first(wall)), 7.0 * std::sqrt(0.3 + 0.7 * 118 / 128), 0.4);
  cv::Mat difference;
  cv::subtract(first(wall), second(wall), difference, cv::noArray(), CV_32F);
  EXPECT_NEAR(deviation(difference) / deviation(first(wall)), std::sqrt(2.0), 0.05);
  // The middle square of 7 x 5 is white... the one right of it black.
  const Eigen::Vector2d centre = testLens().project(cMo.translation());
  const cv::Rect one(static_cast<int>(centre.x()) - 15, static_cast<int>(centre.y()) - 15, 30, 30);
  const cv::Rect other(one.x + 53, one.y, 30, 30);
  const double one_gray = cv::mean(first(one))[0], other_gray = cv::mean(first(other))[0];
  const bool one_is_white = one_gray > other_gray;
  EXPECT_GT(std::abs(one_gray - other_gray), 100.0);
  EXPECT_GT(deviation(first(one_is_white ? one : other)), 1.2 * deviation(first(one_is_white ? other : one)));
}

}  // namespace
}  // namespace servocal::sim
