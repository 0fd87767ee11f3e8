// SPDX-License-Identifier: GPL-3.0-or-later
// Real recordings, corners by OpenCV's finder: the solvers alone are on trial. The folder is named by the
// environment variable SERVOCAL_TEST_DATA; without it these tests skip.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "servocal/calib/intrinsics.h"
#include "servocal/calib/reprojection.h"

namespace servocal::calib {
namespace {

namespace fs = std::filesystem;

constexpr const char* kCamera = "cam";

class RealData : public testing::Test {
 protected:
  void SetUp() override {
    const char* folder = std::getenv("SERVOCAL_TEST_DATA");
    if (!folder || !fs::is_directory(folder)) GTEST_SKIP() << "SERVOCAL_TEST_DATA names no folder";
    data_ = folder;
  }
  fs::path data_;
};

/// Corners in the finder's order; views without a board drop out.
struct Recording {
  BoardSpec board;
  std::vector<Observation> observations;
};

BoardSpec boardOf(int corners_x, int corners_y, double square_size_m) {
  BoardSpec board;
  board.pattern = Checkerboard{corners_x + 1, corners_y + 1, square_size_m, false};
  return board;
}

Recording detectAll(const std::vector<fs::path>& files, const BoardSpec& board) {
  Recording recording{board, {}};
  for (const fs::path& file : files) {
    const cv::Mat image = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    if (image.empty()) throw std::runtime_error("cannot read " + file.string());
    std::vector<cv::Point2f> corners;
    const cv::Size size(board.as<Checkerboard>()->cornersX(), board.as<Checkerboard>()->cornersY());
    if (!cv::findChessboardCorners(image, size, corners)) continue;
    cv::cornerSubPix(image, corners, {5, 5}, {-1, -1}, cv::TermCriteria(3, 50, 1e-4));
    Observation observation;
    observation.id = static_cast<std::int64_t>(recording.observations.size()) + 1;
    observation.stage = file.filename().string();
    StreamObservation seen;
    seen.camera = kCamera;
    seen.width_px = image.cols;
    seen.height_px = image.rows;
    seen.image_file = file.filename().string();
    seen.detection.orientation_known = board.symmetry() == 1;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      seen.detection.corners.push_back(
          {static_cast<int>(i), {corners[i].x, corners[i].y}, Eigen::Matrix2d::Identity() * 0.01});
    }
    observation.views.push_back(seen);
    recording.observations.push_back(observation);
  }
  return recording;
}

void expectOptimumOfOpenCv(const Recording& recording) {
  std::vector<std::vector<cv::Point3f>> points;
  std::vector<std::vector<cv::Point2f>> pixels;
  for (const Observation& observation : recording.observations) {
    points.emplace_back();
    pixels.emplace_back();
    for (const Corner& corner : observation.views[0].detection.corners) {
      const Eigen::Vector3d point = recording.board.corner(corner.id);
      points.back().emplace_back(point.x(), point.y(), 0.f);
      pixels.back().emplace_back(corner.pixel.x(), corner.pixel.y());
    }
  }
  const StreamObservation& first = recording.observations[0].views[0];
  cv::Mat matrix, distortion;
  std::vector<cv::Mat> rotations, translations;
  const double reference_px =
      cv::calibrateCamera(points, pixels, cv::Size(first.width_px, first.height_px), matrix, distortion, rotations,
                          translations, 0, cv::TermCriteria(3, 500, 1e-15));
  IntrinsicsOptions options;
  options.outlier_ratio = 0;  // as many views as the reference
  const IntrinsicsOutcome outcome =
      solveIntrinsics(recording.board, recording.observations, kCamera, Stream::kColor, options);
  ASSERT_EQ(outcome.status, IntrinsicsStatus::kSolved) << toString(outcome.status);
  const IntrinsicsResult& result = *outcome.result;
  std::cout << recording.observations.size() << " views, RMS " << result.rms_px << " px (OpenCV " << reference_px
            << "), " << result.camera.parameters.transpose() << "\n  sigma " << result.sigma.transpose() << '\n';
  EXPECT_NEAR(result.rms_px, reference_px, 1e-5 * reference_px);
  // Single precision of OpenCV's input is all that separates the two.
  EXPECT_NEAR(result.camera.fx(), matrix.at<double>(0, 0), 1e-3);
  EXPECT_NEAR(result.camera.fy(), matrix.at<double>(1, 1), 1e-3);
  EXPECT_NEAR(result.camera.cx(), matrix.at<double>(0, 2), 1e-3);
  EXPECT_NEAR(result.camera.cy(), matrix.at<double>(1, 2), 1e-3);
  for (int i = 4; i < 9; ++i) {
    EXPECT_NEAR(result.camera.parameters[i], distortion.at<double>(i - 4), 0.01 * result.sigma[i]);
  }
  // Nothing is left out by default either.
  const IntrinsicsOutcome gated =
      solveIntrinsics(recording.board, recording.observations, kCamera, Stream::kColor);
  ASSERT_EQ(gated.status, IntrinsicsStatus::kSolved);
  for (const ViewResidual& view : gated.result->views) EXPECT_TRUE(view.used) << view.name;
}

std::vector<fs::path> numbered(const fs::path& folder, const std::string& stem, int last) {
  std::vector<fs::path> files;
  for (int i = 1; i <= last; ++i) {
    const fs::path file = folder / (stem + (i < 10 ? "0" : "") + std::to_string(i) + ".jpg");
    if (fs::exists(file)) files.push_back(file);
  }
  return files;
}

TEST_F(RealData, SonyIntrinsics) {
  const Recording recording =
      detectAll(numbered(data_ / "boofcv/Sony_DSC-HX5V_Chess", "frame", 13), boardOf(4, 6, 0.03));
  ASSERT_EQ(recording.observations.size(), 13u);
  expectOptimumOfOpenCv(recording);
}

TEST_F(RealData, OpenCvLeftIntrinsics) {
  const Recording recording = detectAll(numbered(data_ / "opencv_stereo", "left", 14), boardOf(9, 6, 0.025));
  ASSERT_EQ(recording.observations.size(), 13u);
  expectOptimumOfOpenCv(recording);
}

TEST_F(RealData, OpenCvRightIntrinsics) {
  const Recording recording = detectAll(numbered(data_ / "opencv_stereo", "right", 14), boardOf(9, 6, 0.025));
  ASSERT_EQ(recording.observations.size(), 13u);
  expectOptimumOfOpenCv(recording);
}

TEST_F(RealData, EyeInHand) {
  const fs::path folder = data_ / "yz_toolkit/eye_in_hand_test_data";
  std::vector<fs::path> files;
  for (const int number : {0, 4, 8, 12, 16, 20}) files.push_back(folder / (std::to_string(number) + ".jpg"));
  Recording recording = detectAll(files, boardOf(11, 8, 0.02));
  ASSERT_EQ(recording.observations.size(), 6u);
  for (Observation& observation : recording.observations) {
    std::ifstream stream(folder / fs::path(observation.stage).replace_extension(".json"));
    const auto rows = nlohmann::json::parse(stream)["end2base"];
    Eigen::Isometry3d bMe = Eigen::Isometry3d::Identity();
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column) bMe(row, column) = rows[row][column];
    }
    observation.robot.emplace();
    observation.robot->bMe = Pose<Base, EndEffector>(bMe);
  }
  expectOptimumOfOpenCv(recording);
  const IntrinsicsOutcome intrinsics =
      solveIntrinsics(recording.board, recording.observations, kCamera, Stream::kColor);
  ASSERT_EQ(intrinsics.status, IntrinsicsStatus::kSolved);

  ReprojectionOptions options;
  options.mount = Mount::kFlange;
  options.robot_sigma_m = 0.001;   // what the spread of the recording says
  options.robot_sigma_rad = 0.002;
  const HandEyeOutcome outcome = solveHandEyeReprojection(recording.board, intrinsics.result->camera,
                                                          recording.observations, kCamera, Stream::kColor, options);
  ASSERT_EQ(outcome.status, HandEyeStatus::kSolved) << toString(outcome.status);
  const HandEyeSolution& solution = *outcome.solution;
  std::cout << "eMc t " << 1e3 * solution.camera_pose.translation().transpose() << " mm, sigma "
            << 1e3 * solution.camera_sigma.head<3>().transpose() << " mm, scatter " << 1e3 * solution.scatter_m
            << " mm " << solution.scatter_rad * 180 / M_PI << " deg, RMS " << solution.rms_px << " px, robot "
            << 1e3 * solution.robot_rms_m << " mm " << solution.robot_rms_rad * 180 / M_PI << " deg\n";
  for (const ViewResidual& view : solution.views) EXPECT_TRUE(view.used) << view.name << ": " << view.reason;
  // The reference believes the robot. So does this, and gets the same; with the robot's noise in the cost the
  // answer differs by what the claimed uncertainty allows.
  const Eigen::Vector3d reference_m(0.0945, -0.0079, 0.1334);
  const Eigen::Vector3d sigma_m = solution.camera_sigma.head<3>();
  for (int i = 0; i < 3; ++i) {
    EXPECT_LT(std::abs(solution.camera_pose.translation()[i] - reference_m[i]), 3 * sigma_m[i]) << i;
  }
  ReprojectionOptions believing = options;
  believing.robot_sigma_m = 1e-6;
  believing.robot_sigma_rad = 1e-6;
  believing.huber_sigma = 1e3;
  const HandEyeOutcome believed = solveHandEyeReprojection(recording.board, intrinsics.result->camera,
                                                           recording.observations, kCamera, Stream::kColor, believing);
  ASSERT_EQ(believed.status, HandEyeStatus::kSolved) << toString(believed.status);
  std::cout << "robot believed: eMc t " << 1e3 * believed.solution->camera_pose.translation().transpose()
            << " mm, RMS " << believed.solution->rms_px << " px\n";
  EXPECT_LT((believed.solution->camera_pose.translation() - reference_m).norm(), 0.001);
  EXPECT_NEAR(believed.solution->rms_px, 0.40, 0.05);
  EXPECT_NEAR(solution.scatter_m, 0.00084, 0.0005);
  EXPECT_NEAR(solution.scatter_rad * 180 / M_PI, 0.16, 0.1);

  // The cell's default robot noise is too small for this arm; the answer must not fall apart for it.
  options.robot_sigma_m = 0.0003;
  options.robot_sigma_rad = 0.0005;
  const HandEyeOutcome tight = solveHandEyeReprojection(recording.board, intrinsics.result->camera,
                                                        recording.observations, kCamera, Stream::kColor, options);
  ASSERT_EQ(tight.status, HandEyeStatus::kSolved);
  std::cout << "with the default robot noise: eMc t " << 1e3 * tight.solution->camera_pose.translation().transpose()
            << " mm, RMS " << tight.solution->rms_px << " px\n";
  for (const ViewResidual& view : tight.solution->views) EXPECT_TRUE(view.used) << view.name << ": " << view.reason;
  EXPECT_LT((tight.solution->camera_pose.translation() - reference_m).norm(), 0.005);
}

}  // namespace
}  // namespace servocal::calib
