// SPDX-License-Identifier: GPL-3.0-or-later
// Real recordings with images and robot poses spoilt on purpose: servocal names those, and no others.
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <random>
#include <set>

#include "run_program.h"
#include "servocal/calib/board_pose.h"
#include "servocal/procedure/recorded.h"
#include "servocal/procedure/solve.h"
#include "servocal/procedure/summary.h"

namespace servocal {
namespace {

constexpr int kInjections = 20;

std::optional<std::string> dataFolder() {
  const char* folder = std::getenv("SERVOCAL_TEST_DATA");
  return folder != nullptr && *folder != '\0' ? std::optional<std::string>(folder) : std::nullopt;
}

std::vector<std::size_t> someOf(std::size_t all, std::size_t count, std::mt19937_64& random) {
  std::vector<std::size_t> out(all);
  for (std::size_t i = 0; i < all; ++i) out[i] = i;
  std::shuffle(out.begin(), out.end(), random);
  out.resize(count);
  return out;
}

/// The causes that are true of each spoilt view, by its index.
using Injected = std::map<std::size_t, std::set<ViewCause>>;

void expectNamed(const std::vector<ViewResidual>& views, const Injected& injected, int seed) {
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto bad = injected.find(i);
    EXPECT_EQ(views[i].used, bad == injected.end()) << "seed " << seed << ", " << views[i].name << ": "
                                                    << views[i].reason << " " << views[i].rms_px << " px";
    if (views[i].used || bad == injected.end()) continue;
    EXPECT_TRUE(bad->second.count(views[i].cause))
        << "seed " << seed << ", " << views[i].name << ": " << views[i].reason;
  }
}

// OpenCV's left images; in the place of up to three, another board.
TEST(RealDataOutliers, OtherBoardsAreNamed) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const session::ImageSet original = session::loadImageSet(SERVOCAL_MANIFESTS "/opencv_left.yaml", *data);
  ASSERT_EQ(original.images.size(), 13u);
  const CalibrationResult clean = procedure::solveImages({original});
  ASSERT_EQ(clean.cameras.size(), 1u);
  for (int seed = 1; seed <= kInjections; ++seed) {
    std::mt19937_64 random(seed);
    const test::TemporaryFolder folder;
    session::ImageSet set = original;
    Injected injected;
    for (const std::size_t i : someOf(13, 1 + seed % 3, random)) {
      cv::Mat image = session::readImage(set.images[i].file);
      switch (random() % 2) {
        case 0: {  // the same number of squares, another board and another camera
          const cv::Mat other = session::readImage(*data + "/caliscope_chess/cam_0_frame_200.jpg");
          cv::resize(other, image, image.size());
          injected[i] = {ViewCause::kCorners, ViewCause::kBlurred, ViewCause::kNoBoard};
          break;
        }
        default:  // another number of squares
          image = session::readImage(*data + "/boofcv/Sony_DSC-HX5V_Chess/frame0" +
                                     std::to_string(1 + random() % 9) + ".jpg");
          injected[i] = {ViewCause::kNoBoard};
      }
      set.images[i].file = folder / (std::to_string(i) + ".png");
      cv::imwrite(set.images[i].file.string(), image);
    }
    const CalibrationResult result = procedure::solveImages({set});
    ASSERT_EQ(result.cameras.size(), 1u) << seed;
    expectNamed(result.cameras[0].intrinsics.views, injected, seed);
  }
}

// The eye-in-hand recording: poses swapped, inverted, displaced, mirrored.
TEST(RealDataOutliers, WrongRobotPosesAreNamed) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const session::ImageSet set = session::loadImageSet(SERVOCAL_MANIFESTS "/yz_eye_in_hand.yaml", *data);
  const std::vector<Observation> original = procedure::detectImages(set);
  procedure::SolveOptions options;
  options.mount = set.mount;
  options.robot_sigma_m = set.robot_accuracy_m;
  options.robot_sigma_rad = set.robot_accuracy_rad;
  const CalibrationResult clean = procedure::solve(set.board, original, options);
  ASSERT_TRUE(clean.cameras.at(0).hand_eye.has_value());
  const HandEyeSolution& truth = *clean.cameras[0].hand_eye;
  const CameraModel& camera = clean.cameras[0].intrinsics.camera;
  for (int seed = 1; seed <= kInjections; ++seed) {
    std::mt19937_64 random(seed);
    std::vector<Observation> observations = original;
    const auto bMe = [&](std::size_t i) -> Pose<Base, EndEffector>& { return observations[i].robot->bMe; };
    const auto at = someOf(original.size(), 2, random);
    Injected injected;
    std::string word;
    switch (seed % 4) {
      case 0:
        bMe(at[0]) = bMe(at[1]);  // as if a row had been copied
        injected[at[0]] = {ViewCause::kRobotPose};
        word = "mm";
        break;
      case 1:
        bMe(at[0]) = relabel<Base, EndEffector>(bMe(at[0]).inverse());
        injected[at[0]] = {ViewCause::kRobotPose};
        word = "its inverse fits";
        break;
      case 2:
        bMe(at[0]) =
            bMe(at[0]) * Pose<EndEffector, EndEffector>::fromRotationVector({0.0, 0.0, 0.0}, {0.03, 0, 0});
        injected[at[0]] = {ViewCause::kRobotPose};
        word = "wrong robot pose: it is";
        break;
      default: {
        const auto poses = calib::boardPoses(set.board, camera, original[at[0]].views[0].detection);
        // So near to the camera there is often only one; then its mirror image about the line of sight.
        const Pose<Color, Board>& cMo = poses.at(0).cMo;
        const Eigen::Vector3d sight = cMo.translation().normalized();
        const Eigen::Matrix3d reflection = Eigen::Matrix3d::Identity() - 2.0 * sight * sight.transpose();
        const Pose<Color, Board> mirrored =
            poses.size() > 1
                ? poses[1].cMo
                : Pose<Color, Board>(reflection * cMo.rotation() * Eigen::Vector3d(1, 1, -1).asDiagonal(),
                                     cMo.translation());
        bMe(at[0]) = Pose<Base, EndEffector>(truth.board_pose * mirrored.inverse().isometry() *
                                             truth.camera_pose.inverse());
        injected[at[0]] = {ViewCause::kPoseFlip};
        word = "pose flip";
      }
    }
    const CalibrationResult result = procedure::solve(set.board, observations, options);
    ASSERT_TRUE(result.cameras.at(0).hand_eye.has_value()) << seed << procedure::summary(result);
    expectNamed(result.cameras[0].hand_eye->views, injected, seed);
    const std::string& reason = result.cameras[0].hand_eye->views[at[0]].reason;
    EXPECT_NE(reason.find(word), std::string::npos) << seed << ": " << reason;
    // An inverted pose puts the board behind the camera: a solution with it does not exist, which is said.
    EXPECT_NE(result.cameras[0].hand_eye_with_outliers.has_value(), !result.cameras[0].notes.empty());
  }
}

// Two rows swapped: a third of this small set.
TEST(RealDataOutliers, SwappedRowsAreNamedWithEachOther) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const session::ImageSet set = session::loadImageSet(SERVOCAL_MANIFESTS "/yz_eye_in_hand.yaml", *data);
  const std::vector<Observation> original = procedure::detectImages(set);
  procedure::SolveOptions options;
  options.mount = set.mount;
  options.robot_sigma_m = set.robot_accuracy_m;
  options.robot_sigma_rad = set.robot_accuracy_rad;
  for (std::size_t i = 0; i < original.size(); ++i) {
    for (std::size_t k = i + 1; k < original.size(); ++k) {
      std::vector<Observation> observations = original;
      std::swap(observations[i].robot->bMe, observations[k].robot->bMe);
      const CalibrationResult result = procedure::solve(set.board, observations, options);
      ASSERT_TRUE(result.cameras.at(0).hand_eye.has_value()) << i << " " << k << procedure::summary(result);
      const auto& views = result.cameras[0].hand_eye->views;
      expectNamed(views, {{i, {ViewCause::kRobotPose}}, {k, {ViewCause::kRobotPose}}},
                  static_cast<int>(10 * i + k));
      EXPECT_NE(views[i].reason.find("'" + views[k].name + "'"), std::string::npos) << views[i].reason;
      EXPECT_NE(views[k].reason.find("'" + views[i].name + "'"), std::string::npos) << views[k].reason;
    }
  }
}

}  // namespace
}  // namespace servocal
