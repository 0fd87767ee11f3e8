// SPDX-License-Identifier: GPL-3.0-or-later
// servocal-solve as a person runs it, on a small recording that is drawn here, and on damaged ones.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <sstream>

#include "cells.h"
#include "depth_scene.h"
#include "errors.h"
#include "run_program.h"
#include "tag_pictures.h"
#include "servocal/core/board_spec.h"
#include "servocal/core/cell_config.h"
#include "servocal/session/session.h"

namespace servocal {
namespace {

using test::expectPart;

/// A folder of images of a plain 7 x 6 checkerboard without lens distortion, and the robot's poses.
class Recording : public ::testing::Test {
 protected:
  static constexpr double kFocalPx = 700.0, kCxPx = 319.5, kCyPx = 239.5, kSquareM = 0.03;

  void SetUp() override {
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    std::ofstream poses(folder_ / "poses.csv");
    poses.precision(17);
    for (int view = 0; view < 9; ++view) {
      const Eigen::Vector3d turn(0.5 * uniform(random), 0.5 * uniform(random), 0.4 * uniform(random));
      const auto cMo = Pose<Color, Board>::fromRotationVector(
          turn, {0.05 * uniform(random), 0.04 * uniform(random), 0.45 + 0.08 * uniform(random)});
      draw("view" + std::to_string(view) + ".png", cMo);
      writePose(poses, "view" + std::to_string(view), bMc_ * cMo * eMo_.inverse());
    }
    // An image without a board, whose robot pose would spoil everything if it were used.
    cv::imwrite((folder_ / "view9.png").string(), cv::Mat(480, 640, CV_8UC1, cv::Scalar(120)));
    writePose(poses, "view9", Pose<Base, EndEffector>(Eigen::Matrix3d::Identity(), {9, 9, 9}));
    poses.close();
    folder_.write("set.yaml", manifest());
  }

  static std::string manifest(const std::string& mount = "eye_to_hand", const std::string& pose = "bMe") {
    return "camera: cam\nboard: {squares_x: 7, squares_y: 6, square_size_m: 0.03, hollow_corner: false}\n"
           "images: \"view*.png\"\nmount: " +
           mount + "\nposes:\n  pose: " + pose +
           "\n  format: rotation_vector\n  length_unit: m\n  angle_unit: rad\n  table: poses.csv\n"
           "  columns: [image, x, y, z, rx, ry, rz]\n";
  }

  static void writePose(std::ostream& out, const std::string& name, const Pose<Base, EndEffector>& pose) {
    const Eigen::Vector3d t = pose.translation(), r = pose.rotationVector();
    out << name << ", " << t.x() << ", " << t.y() << ", " << t.z() << ", " << r.x() << ", " << r.y() << ", "
        << r.z() << '\n';
  }

  void draw(const std::string& name, const Pose<Color, Board>& cMo) const {
    // Drawn large, then warped and shrunk by area, so that edges are smooth.
    constexpr int kPixelsPerSquare = 80, kOversampling = 4;
    cv::Mat pattern(8 * kPixelsPerSquare, 9 * kPixelsPerSquare, CV_8UC1, cv::Scalar(230));
    for (int row = 0; row < 6; ++row) {
      for (int column = 0; column < 7; ++column) {
        if ((row + column) % 2 != 0) continue;
        cv::rectangle(pattern,
                      {(column + 1) * kPixelsPerSquare, (row + 1) * kPixelsPerSquare, kPixelsPerSquare,
                       kPixelsPerSquare},
                      cv::Scalar(25), cv::FILLED);
      }
    }
    Eigen::Matrix3d from_pattern;  // pattern pixel -> board, m; a pixel's centre is at its index
    const double scale = kSquareM / kPixelsPerSquare;
    from_pattern << scale, 0, scale * 0.5 - 4.5 * kSquareM, 0, scale, scale * 0.5 - 4 * kSquareM, 0, 0, 1;
    Eigen::Matrix3d projection, k, enlarge;
    projection << cMo.rotation().leftCols<2>(), cMo.translation();
    k << kFocalPx, 0, kCxPx, 0, kFocalPx, kCyPx, 0, 0, 1;
    const double shift = 0.5 * (kOversampling - 1);
    enlarge << kOversampling, 0, shift, 0, kOversampling, shift, 0, 0, 1;
    const Eigen::Matrix3d h = enlarge * k * projection * from_pattern;
    cv::Mat homography(3, 3, CV_64F), big, image;
    for (int i = 0; i < 9; ++i) homography.at<double>(i / 3, i % 3) = h(i / 3, i % 3);
    cv::warpPerspective(pattern, big, homography, cv::Size(640 * kOversampling, 480 * kOversampling),
                        cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(150));
    cv::resize(big, image, cv::Size(640, 480), 0, 0, cv::INTER_AREA);
    cv::Mat noise(image.size(), CV_16SC1);
    cv::randn(noise, 0, 2);  // OpenCV's default generator: the same in every run
    cv::add(image, noise, image, cv::noArray(), CV_8U);
    cv::imwrite((folder_ / name).string(), image);
  }

  test::ProgramRun solve(const std::string& arguments) const {
    return test::runProgram("cd " + test::shellWord(folder_.path().string()) + " && " SERVOCAL_SOLVE " " +
                            arguments);
  }

  test::TemporaryFolder folder_;
  const Pose<Base, Color> bMc_ = Pose<Base, Color>::fromRotationVector({0.3, 2.0, -0.5}, {0.8, -0.2, 0.5});
  const Pose<EndEffector, Board> eMo_ =
      Pose<EndEffector, Board>::fromRotationVector({0.1, -0.2, 0.3}, {0.01, 0.02, 0.1});
};

TEST_F(Recording, EyeToHandFromImagesToResultFile) {
  const test::ProgramRun run = solve("set.yaml --out new/result.json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  EXPECT_EQ(run.out.substr(run.out.rfind("Wrote")), "Wrote new/result.json\n");
  expectPart(run.out, "9 of 10 views");
  expectPart(run.out, "view9.png (no board found; its robot pose is left out too)");
  const auto result = nlohmann::json::parse(std::ifstream(folder_ / "new/result.json"));
  const auto& camera = result["cameras"][0];
  EXPECT_NEAR(camera["intrinsics"]["parameters"]["fx_px"]["value"].get<double>(), kFocalPx, 1.5);
  EXPECT_NEAR(camera["intrinsics"]["parameters"]["cx_px"]["value"].get<double>(), kCxPx, 1.5);
  EXPECT_LT(camera["intrinsics"]["rms_px"].get<double>(), 0.1);
  EXPECT_EQ(camera["hand_eye"]["mount"], "fixed");
  EXPECT_EQ(camera["hand_eye"]["views_used"], 9);
  EXPECT_EQ(camera["hand_eye"]["views"].size(), 10u);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(camera["hand_eye"]["camera_pose"]["translation_m"][i].get<double>(), bMc_.translation()[i],
                0.002);
  }
}

// The same images, read as a camera on the flange: the inverse robot poses make it the same geometry.
TEST_F(Recording, EyeInHandIsTheSameWithInvertedPoses) {
  folder_.write("set.yaml", manifest("eye_in_hand", "eMb"));
  const test::ProgramRun run = solve("set.yaml --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto result = nlohmann::json::parse(run.out);
  const auto& hand_eye = result["cameras"][0]["hand_eye"];
  EXPECT_EQ(hand_eye["camera_pose"]["name"], "eMc");
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(hand_eye["camera_pose"]["translation_m"][i].get<double>(), bMc_.translation()[i], 0.002);
  }
}

TEST_F(Recording, GivenIntrinsicsAreBelieved) {
  folder_.write(
      "camera.yaml",
      "image_width: 640\nimage_height: 480\n"
      "camera_matrix: {rows: 3, cols: 3, data: [700, 0, 319.5, 0, 700, 239.5, 0, 0, 1]}\n"
      "distortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n");
  folder_.write("set.yaml", manifest() + "intrinsics_file: camera.yaml\n");
  const test::ProgramRun run = solve("set.yaml --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto result = nlohmann::json::parse(run.out);
  EXPECT_EQ(result["cameras"][0]["intrinsics"]["source"], "given");
  EXPECT_EQ(result["cameras"][0]["intrinsics"]["parameters"]["fx_px"]["value"], 700.0);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(result["cameras"][0]["hand_eye"]["camera_pose"]["translation_m"][i].get<double>(),
                bMc_.translation()[i], 0.001);
  }
}

TEST_F(Recording, DamagedInputIsNamedAndHasItsExitCode) {
  const auto expectRefusal = [&](const std::string& arguments, int exit_code, const std::string& part) {
    const test::ProgramRun run = solve(arguments);
    EXPECT_EQ(run.exit_code, exit_code) << run.err;
    expectPart(run.err, part);
    EXPECT_EQ(run.out, "");
  };
  expectRefusal("nowhere.yaml", 3, "nowhere.yaml': there is no such file");
  folder_.write("typo.yaml", manifest() + "lenz: plumb_bob\n");
  expectRefusal("typo.yaml", 3, "unknown key 'lenz'; did you mean 'lens'?");
  folder_.write("none.yaml",
                "board: {squares_x: 7, squares_y: 6, square_size_m: 0.03, hollow_corner: false}\n"
                "images: \"*.tif\"\n");
  expectRefusal("none.yaml", 2, "matches '*.tif'");
  expectRefusal("set.yaml --lens fisheye", 2, "fisheye");
  expectRefusal("set.yaml --out result.txt", 2, "must end in .yaml or .json");
  expectRefusal("set.yaml --fixed k6", 3, "plumb_bob has no parameter 'k6' to fix");
  expectRefusal(".", 8, "holds no session");
  std::filesystem::resize_file(folder_ / "view3.png", 1000);
  expectRefusal("set.yaml", 8, "view3.png' is truncated");
  cv::imwrite((folder_ / "view3.png").string(), cv::Mat(240, 320, CV_8UC1, cv::Scalar(120)));
  expectRefusal("set.yaml", 8, "view3.png' has 320x240 px, most others have 640x480");
}

/// The rows of the pose table, each changed.
void rewriteTable(const std::filesystem::path& file,
                  const std::function<std::vector<double>(std::vector<double>)>& changed) {
  std::ifstream in(file);
  std::string text;
  for (std::string line; std::getline(in, line);) {
    std::istringstream row(line);
    std::string name, cell;
    std::getline(row, name, ',');
    std::vector<double> values;
    while (std::getline(row, cell, ',')) values.push_back(std::stod(cell));
    text += name;
    for (const double value : changed(values)) {
      char number[40];
      std::snprintf(number, sizeof number, ", %.17g", value);
      text += number;
    }
    text += '\n';
  }
  in.close();
  std::ofstream(file) << text;
}

// Every way in which a set of images and poses is commonly wrong: a sentence with file and cause, exit
// code 8.
class BadInput : public Recording {
 protected:
  void expectBadData(const std::vector<std::string>& parts, const std::string& arguments = "set.yaml") {
    const test::ProgramRun run = solve(arguments);
    EXPECT_EQ(run.exit_code, 8) << run.out << run.err;
    for (const std::string& part : parts) expectPart(run.err, part);
    EXPECT_EQ(run.out, "");
    EXPECT_FALSE(std::filesystem::exists(folder_ / "result.yaml"));
  }
  void rewrite(const std::function<std::vector<double>(std::vector<double>)>& changed) {
    rewriteTable(folder_ / "poses.csv", changed);
  }
};

TEST_F(BadInput, EmptyImage) {
  folder_.write("view4.png", "");
  expectBadData({"view4.png' is empty"});
}

TEST_F(BadInput, EmptyFolderIsNothingToDo) {
  std::filesystem::create_directory(folder_ / "empty");
  folder_.write("set.yaml", manifest() + "folder: empty\n");
  const test::ProgramRun run = solve("set.yaml");
  EXPECT_EQ(run.exit_code, 2) << run.err;
  expectPart(run.err, "no image in 'empty' matches 'view*.png'");
}

TEST_F(BadInput, NotANumberInAPose) {
  std::ofstream(folder_ / "poses.csv", std::ios::app) << "view10, 0.1, nan, 0, 0, 0, 0\n";
  std::filesystem::copy_file(folder_ / "view0.png", folder_ / "view10.png");
  expectBadData({"poses.csv', line 11", "holds nan, not a number"});
}

TEST_F(BadInput, MissingRowAndCountsThatDiffer) {
  std::filesystem::copy_file(folder_ / "view0.png", folder_ / "view10.png");
  expectBadData({"poses.csv'", "no row for image 'view10.png'"});
  std::string text = manifest();
  text.replace(text.find("[image,"), 7, "[skip,");
  folder_.write("set.yaml", text);
  expectBadData({"poses.csv': it has 10 poses for 11 images"});
}

TEST_F(BadInput, DegreesForRadiansAndBack) {
  rewrite([](std::vector<double> v) {
    for (int i = 3; i < 6; ++i) v[i] *= 180 / M_PI;
    return v;
  });
  expectBadData({"poses.csv', line", "look like degrees (angle_unit: deg)"});
  rewrite([](std::vector<double> v) {
    for (int i = 3; i < 6; ++i) v[i] *= M_PI / 180;
    return v;
  });
  std::string text = manifest();
  text.replace(text.find("angle_unit: rad"), 15, "angle_unit: deg");
  folder_.write("set.yaml", text);
  expectBadData(
      {"poses.csv' and the images contradict each other", "the angles are in radians (angle_unit: rad)"});
}

TEST_F(BadInput, MillimetresForMetresAndBack) {
  rewrite([](std::vector<double> v) {
    for (int i = 0; i < 3; ++i) v[i] *= 1000;
    return v;
  });
  expectBadData({"poses.csv', line", "look like millimetres (length_unit: mm)"});
  rewrite([](std::vector<double> v) {
    for (int i = 0; i < 3; ++i) v[i] /= 1000;
    return v;
  });
  std::string text = manifest();
  text.replace(text.find("length_unit: m"), 14, "length_unit: mm");
  folder_.write("set.yaml", text);
  // The row of the image without a board puts the arm 15 m away: without it all are within a metre.
  expectBadData({"poses.csv' and the images contradict each other",
                 "are in metres, read as millimetres (length_unit: m)"});
}

TEST_F(BadInput, InvertedPosesAndTheOtherMount) {
  folder_.write("set.yaml", manifest("eye_to_hand", "eMb"));
  expectBadData({"poses.csv' and the images contradict each other", "the poses are the inverse"});
  folder_.write("set.yaml", manifest("eye_in_hand", "bMe"));
  expectBadData({"eye_to_hand instead of eye_in_hand"});
}

TEST_F(BadInput, EulerAnglesForARotationVector) {
  rewrite([](std::vector<double> v) {
    const auto turn = Pose<Base, EndEffector>::fromRotationVector({v[3], v[4], v[5]}, {0, 0, 0}).rotation();
    const Eigen::Vector3d zyx = turn.eulerAngles(2, 1, 0);  // R = Rz Ry Rx
    return std::vector<double>{v[0], v[1], v[2], zyx[2], zyx[1], zyx[0]};
  });
  expectBadData({"they agree if the angles are Euler angles (euler_order: "});
  const std::string said = solve("set.yaml").err;
  EXPECT_TRUE(said.find("extrinsic_xyz") != std::string::npos ||
              said.find("intrinsic_zyx") != std::string::npos)
      << said;
}

TEST_F(BadInput, WrongSquareSizeAgainstTheRobot) {
  std::string text = manifest();
  text.replace(text.find("square_size_m: 0.03,"), 20, "square_size_m: 0.025,");
  folder_.write("set.yaml", text);
  const test::ProgramRun run = solve("set.yaml");
  EXPECT_EQ(run.exit_code, 8) << run.out << run.err;
  const std::string words = "the squares measure ";
  expectPart(run.err, words);
  expectPart(run.err, "by the robot's motion, not 25 mm");
  EXPECT_NEAR(std::stod(run.err.substr(run.err.find(words) + words.size())), 30.0, 0.3) << run.err;

  // Off by 3 %: worth a note, and the result says by how much.
  text.replace(text.find("square_size_m: 0.025,"), 21, "square_size_m: 0.0291,");
  folder_.write("set.yaml", text);
  const test::ProgramRun noted = solve("set.yaml --json");
  EXPECT_EQ(noted.exit_code, 0) << noted.err;
  const auto camera = nlohmann::json::parse(noted.out)["cameras"][0];
  EXPECT_NEAR(camera["board_scale"]["scale"].get<double>(), 0.03 / 0.0291, 0.005);
  ASSERT_EQ(camera["notes"].size(), 1u) << noted.err;
  expectPart(camera["notes"][0], "by the robot's motion, not 29.1 mm");
  // The true size is no news.
  folder_.write("set.yaml", manifest());
  EXPECT_FALSE(nlohmann::json::parse(solve("set.yaml --json").out)["cameras"][0].contains("notes"));
}

TEST_F(BadInput, InnerCornersCountedForSquares) {
  std::string text = manifest();
  text.replace(text.find("squares_x: 7, squares_y: 6"), 26, "squares_x: 6, squares_y: 5");
  folder_.write("set.yaml", text);
  expectBadData({"in 9: its inner corners were counted instead of its squares"});
}

// Tags are numbered row by row: with rows for columns the codes are elsewhere. (A checkerboard does not
// mind.)
TEST_F(BadInput, RowsAndColumnsOfTheBoardSwapped) {
  BoardSpec board;
  TagGrid grid;
  grid.tags_x = 5;
  grid.tags_y = 3;
  grid.tag_size_m = 0.03;
  grid.tag_gap_m = 0.009;
  board.pattern = grid;
  for (int view = 0; view < 6; ++view) {
    test::TagPictureOptions options;
    options.square_px = 60;
    options.tilt_rad = 0.4;
    options.tilt_axis_rad = view;
    options.seed = static_cast<unsigned>(view + 1);
    cv::imwrite((folder_ / ("tags" + std::to_string(view) + ".png")).string(),
                test::renderTags(board, options).gray);
  }
  const auto manifestOf = [](const std::string& size) {
    return "board: {kind: aprilgrid, " + size +
           ", tag_size_m: 0.03, tag_gap_m: 0.009}\nimages: \"tags*.png\"\n";
  };
  folder_.write("set.yaml", manifestOf("tags_x: 3, tags_y: 5"));
  expectBadData({"in 6: its rows and columns are swapped"});
  folder_.write("set.yaml", manifestOf("tags_x: 5, tags_y: 3"));
  EXPECT_EQ(solve("set.yaml").exit_code, 0);
}

TEST_F(BadInput, RowsAndColumnsOfAPlainCheckerboardDoNotMatter) {
  std::string text = manifest();
  text.replace(text.find("squares_x: 7, squares_y: 6"), 26, "squares_x: 6, squares_y: 7");
  folder_.write("set.yaml", text);
  const test::ProgramRun run = solve("set.yaml --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto result = nlohmann::json::parse(run.out);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(result["cameras"][0]["hand_eye"]["camera_pose"]["translation_m"][i].get<double>(),
                bMc_.translation()[i], 0.002);
  }
}

TEST_F(Recording, OutliersAreNamedAndComparedInFile) {
  rewriteTable(folder_ / "poses.csv", [n = 0](std::vector<double> v) mutable {
    if (n++ == 5) v[0] += 0.04;
    return v;
  });
  const test::ProgramRun run = solve("set.yaml --out result.json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  expectPart(run.out, "left out: view5.png (wrong robot pose: it is 40.");
  expectPart(run.out, "the outliers");
  const auto result = nlohmann::json::parse(std::ifstream(folder_ / "result.json"));
  const auto& hand_eye = result["cameras"][0]["hand_eye"];
  EXPECT_EQ(hand_eye["views_used"], 8);
  EXPECT_EQ(hand_eye["views"][5]["cause"], "robot_pose");
  EXPECT_EQ(hand_eye["views"][9]["cause"], "no_board");
  EXPECT_EQ(hand_eye["with_outliers"]["views_used"], 9);
  EXPECT_GT(hand_eye["with_outliers"]["scatter_m"], 5 * hand_eye["scatter_m"].get<double>());
  EXPECT_FALSE(result["cameras"][0]["intrinsics"].contains("with_outliers"));
  EXPECT_EQ(hand_eye["symmetric_views"], 0);  // 7 x 6 squares look the same after no turn
}

TEST_F(Recording, NoBoardAnywhereIsAGoalNotMet) {
  folder_.write("set.yaml",
                "board: {squares_x: 12, squares_y: 9, square_size_m: 0.03, hollow_corner: false}\n"
                "images: \"view*.png\"\n");
  const test::ProgramRun run = solve("set.yaml --json");
  EXPECT_EQ(run.exit_code, 4) << run.err;
  expectPart(run.err, "the board was found in none of 10 images");
}

TEST(SolveApp, SolvesARecordedSession) {
  // Views of the default board by an ideal camera; the session holds corners, no images.
  const test::TemporaryFolder folder;
  const BoardSpec board;
  CameraModel camera = CameraModel::fromFieldOfView(1920, 1080, 1.466);
  const auto bMc = Pose<Base, Color>::fromRotationVector({0.3, 2.0, -0.5}, {0.8, -0.2, 0.5});
  const auto eMo = Pose<EndEffector, Board>::fromRotationVector({0.1, -0.2, 0.3}, {0.01, 0.02, 0.1});
  std::mt19937_64 random(12);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::normal_distribution<double> noise(0.0, 0.05);
  {
    session::Session session = session::Session::create(folder / "run", test::oneCameraCell().text, board, 1);
    for (int view = 0; view < 12; ++view) {
      const auto cMo = Pose<Color, Board>::fromRotationVector(
          {0.5 * uniform(random), 0.5 * uniform(random), 0.4 * uniform(random)},
          {0.2 * uniform(random), 0.1 * uniform(random), 0.5 + 0.1 * uniform(random)});
      Observation observation;
      observation.stage = "cover";
      observation.robot.emplace();
      observation.robot->q = Eigen::VectorXd::Zero(6);
      observation.robot->bMe = bMc * cMo * eMo.inverse();
      StreamObservation seen;
      seen.camera = test::oneCameraCell().cameras.front().name;
      seen.width_px = 1920;
      seen.height_px = 1080;
      seen.detection.orientation_known = true;
      for (int id = 0; id < board.cornerCount(); ++id) {
        Corner corner;
        corner.id = id;
        corner.pixel =
            *camera.project(cMo * board.corner(id)) + Eigen::Vector2d(noise(random), noise(random));
        corner.covariance_px2 = 0.0025 * Eigen::Matrix2d::Identity();
        seen.detection.corners.push_back(corner);
      }
      observation.views = {seen};
      session.add(observation, {});
    }
  }
  const test::ProgramRun run = test::runProgram(std::string(SERVOCAL_SOLVE) + " " +
                                                test::shellWord((folder / "run").string()) + " --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto result = nlohmann::json::parse(run.out);
  EXPECT_EQ(result["cameras"][0]["hand_eye"]["views_used"], 12);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(result["cameras"][0]["hand_eye"]["camera_pose"]["translation_m"][i].get<double>(),
                bMc.translation()[i], 0.003);
  }
}

// A session without robot poses of a camera whose depth is right: squares of 30 mm, described as `stated_m`.
test::ProgramRun solveDepthSession(double stated_m) {
  const test::TemporaryFolder folder;
  DepthModel ideal = test::timeOfFlight();
  ideal.offset = 0.0;
  ideal.slope = 1.0;
  ideal.nodes.setZero();
  test::SceneOptions options;
  options.views = 20;
  const test::DepthScene scene = test::makeDepthScene(3, ideal, options, {0.1, 0.001, 0.002});
  const CameraModel color = CameraModel::fromFieldOfView(1920, 1080, 1.9);
  const CellConfig cell = defaultCell();
  std::mt19937_64 random(5);
  BoardSpec stated = scene.board;
  std::get<Checkerboard>(stated.pattern).square_size_m = stated_m;
  {
    session::Session session = session::Session::create(folder / "run", cell.text, stated, 1);
    for (std::size_t i = 0; i < scene.observations.size(); ++i) {
      Observation observation = scene.observations[i];
      observation.robot.reset();
      StreamObservation& infrared = observation.views.front();
      infrared.camera = cell.cameras.front().name;
      StreamObservation seen = infrared;
      seen.stream = Stream::kColor;
      seen.depth.reset();
      seen.width_px = color.width_px;
      seen.height_px = color.height_px;
      std::normal_distribution<double> noise(0.0, 0.1);
      for (Corner& corner : seen.detection.corners) {
        corner.pixel = *color.project(scene.cell.cMo[i] * scene.board.corner(corner.id)) +
                       Eigen::Vector2d(noise(random), noise(random));
      }
      observation.views.push_back(seen);
      session.add(observation, {});
    }
  }
  return test::runProgram(std::string(SERVOCAL_SOLVE) + " " + test::shellWord((folder / "run").string()) + " --json");
}

TEST(SolveApp, WrongSquareSizeAgainstDepth) {
  const test::ProgramRun run = solveDepthSession(0.025);
  EXPECT_EQ(run.exit_code, 8) << run.out << run.err;
  const std::string words = "they agree if the squares measure ";
  expectPart(run.err, "depth of ");
  expectPart(run.err, words);
  expectPart(run.err, "mm by the depth, not 25 mm");
  EXPECT_NEAR(std::stod(run.err.substr(run.err.find(words) + words.size())), 30.0, 0.3) << run.err;
  // The true size is no news.
  const test::ProgramRun right = solveDepthSession(0.03);
  EXPECT_EQ(right.exit_code, 0) << right.out << right.err;
}

}  // namespace
}  // namespace servocal
