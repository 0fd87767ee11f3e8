// SPDX-License-Identifier: GPL-3.0-or-later
// Frames, refusals and names of the exports.
#include "servocal/report/export.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "errors.h"
#include "random_result.h"
#include "run_program.h"
#include "servocal/session/session.h"
#include "temporary_folder.h"

namespace servocal::report {
namespace {

using test::expectPart;

/// Solved in stages alone.
CalibrationResult example(int cameras = 2) {
  CalibrationResult result = test::RandomResult(3).make(cameras);
  result.joint.reset();
  return result;
}

std::string textOf(const Export& exported, const std::string& name) {
  for (const ExportedFile& file : exported.files) {
    if (file.name == name) return file.text;
  }
  ADD_FAILURE() << "no file " << name;
  return "";
}

struct Transform {
  std::string parent;
  Eigen::Isometry3d pose;
};

/// Runs the launch file with stand-ins for ROS's modules, and returns what it would publish, by child.
std::map<std::string, Transform> published(const Export& exported) {
  const test::TemporaryFolder folder;
  writeExport(exported, folder.path());
  folder.write("launch.py", "class LaunchDescription(list): pass\n");
  folder.write("launch_ros/__init__.py", "");
  folder.write(
      "launch_ros/actions.py",
      "def Node(package, executable, arguments):\n"
      "    assert (package, executable) == ('tf2_ros', 'static_transform_publisher')\n"
      "    named = dict(zip(arguments[0::2], arguments[1::2]))\n"
      "    keys = ['--frame-id', '--child-frame-id', '--x', '--y', '--z', '--qx', '--qy', '--qz', '--qw']\n"
      "    assert set(named) == set(keys), named\n"
      "    print(*[named[key] for key in keys])\n");
  folder.write("run.py",
               "import importlib.util, sys\n"
               "spec = importlib.util.spec_from_file_location('file', 'static_transforms.launch.py')\n"
               "module = importlib.util.module_from_spec(spec)\nspec.loader.exec_module(module)\n"
               "module.generate_launch_description()\n");
  const test::ProgramRun run =
      test::runProgram("cd " + test::shellWord(folder.path().string()) + " && python3 run.py");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  std::map<std::string, Transform> transforms;
  std::istringstream in(run.out);
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::string parent, child;
    Eigen::Vector3d t;
    Eigen::Vector4d q;
    words >> parent >> child >> t.x() >> t.y() >> t.z() >> q.x() >> q.y() >> q.z() >> q.w();
    EXPECT_FALSE(words.fail()) << line;
    EXPECT_NEAR(q.norm(), 1.0, 1e-15);
    const auto pose = Pose<Base, Color>::fromQuaternion(Eigen::Quaterniond(q), t).isometry();
    EXPECT_TRUE(transforms.emplace(child, Transform{parent, pose}).second) << child << " has two parents";
  }
  return transforms;
}

double apart(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (a.matrix() - b.matrix()).norm();
}

TEST(StaticTf, EveryFrameHasOneParentAndTheChainsGiveTheCalibration) {
  const CalibrationResult result = example(3);
  const auto tf = published(exportResult(result, Format::kRos2StaticTf));
  ASSERT_EQ(tf.size(), 9u);
  for (const CameraResult& camera : result.cameras) {
    const Transform& link = tf.at(camera.camera + "_link");
    const Transform& color = tf.at(camera.camera + "_color_optical_frame");
    const Transform& infrared = tf.at(camera.camera + "_infrared_optical_frame");
    EXPECT_EQ(link.parent, camera.hand_eye->mount == Mount::kFixed ? "base" : "tool0");
    EXPECT_EQ(color.parent, camera.camera + "_link");
    EXPECT_EQ(infrared.parent, camera.camera + "_color_optical_frame");
    EXPECT_LT(apart(link.pose * color.pose, camera.hand_eye->camera_pose), 1e-14);
    EXPECT_LT(apart(infrared.pose, camera.color_infrared->first_by_second), 1e-14);
    // The link looks along its x, with z up: the optical z and -y.
    EXPECT_LT((color.pose.linear() * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitX()).norm(), 1e-15);
    EXPECT_LT((color.pose.linear() * -Eigen::Vector3d::UnitY() - Eigen::Vector3d::UnitZ()).norm(), 1e-15);
  }
}

TEST(StaticTf, WhatADriverPublishesIsLeftToIt) {
  const CalibrationResult result = example(2);
  ExportOptions options;
  options.base_frame = "ur5/base";
  const auto chain =
      Pose<Base, Color>::fromRotationVector({1.2, -1.2, 1.2}, {0.01, 0.015, -0.002}).isometry();
  options.drivers["cam1"] = {"cam1_mount", chain};
  const auto tf = published(exportResult(result, Format::kRos2StaticTf, options));
  ASSERT_EQ(tf.size(), 4u);  // three of cam2, one of cam1
  EXPECT_EQ(tf.at("cam1_mount").parent, "ur5/base");
  EXPECT_LT(apart(tf.at("cam1_mount").pose * chain, result.cameras[0].hand_eye->camera_pose), 1e-14);
  EXPECT_EQ(tf.count("cam1_color_optical_frame"), 0u);

  const std::string calib = textOf(exportResult(result, Format::kEasyHandEye2, options), "cam1.calib");
  expectPart(calib, "tracking_base_frame: cam1_mount");
  options.drivers["cam7"] = options.drivers["cam1"];
  EXPECT_THROW((void)exportResult(result, Format::kRos2StaticTf, options), std::invalid_argument);
}

TEST(StaticTf, ACameraWithoutHandEyeHangsFromTheOneItWasCalibratedWith) {
  CalibrationResult result = example(2);
  result.cameras[1].hand_eye.reset();
  result.cameras[1].hand_eye_with_outliers.reset();
  const auto tf = published(exportResult(result, Format::kRos2StaticTf));
  EXPECT_EQ(tf.at("cam2_link").parent, "cam1_color_optical_frame");
  EXPECT_LT(apart(tf.at("cam2_link").pose * tf.at("cam2_color_optical_frame").pose,
                  result.camera_pairs[0].first_by_second),
            1e-14);
  result.camera_pairs.clear();
  result.cameras[0].hand_eye.reset();
  for (CameraResult& camera : result.cameras) camera.infrared.reset();
  for (CameraResult& camera : result.cameras) camera.hand_eye.reset();
  EXPECT_EQ(exportResult(result, Format::kOpenCv).status, ExportStatus::kComplete);  // lenses need no pose
  EXPECT_EQ(exportResult(result, Format::kEasyHandEye2).status, ExportStatus::kRefused);
}

TEST(Export, LensesAndPosesAreThoseOfTheJointEstimate) {
  const CalibrationResult result = test::RandomResult(3).make(1);
  const JointCameraResult &color = *result.joint->find("cam1", Stream::kColor),
                          &infrared = *result.joint->find("cam1", Stream::kInfrared);
  const auto tf = published(exportResult(result, Format::kRos2StaticTf));
  EXPECT_LT(apart(tf.at("cam1_link").pose * tf.at("cam1_color_optical_frame").pose, color.pose), 1e-14);
  EXPECT_LT(apart(tf.at("cam1_infrared_optical_frame").pose, result.joint->pairs[0].first_by_second), 1e-14);
  const Export lenses = exportResult(result, Format::kRosCameraInfo);
  const auto number = [](double value) {
    char text[40];
    std::snprintf(text, sizeof text, "%.17g", value);
    return std::string(text);
  };
  expectPart(textOf(lenses, "cam1_color.yaml"), number(color.model.fx()));
  expectPart(textOf(lenses, "cam1_infrared.yaml"), number(infrared.model.fx()));
  expectPart(lenses.notes.back(), "joint estimate");
  expectPart(exportResult(example(1), Format::kRosCameraInfo).notes.back(), "found in stages");
}

// What a format cannot hold is refused with the reason, never truncated.
TEST(Export, RefusesWhatTheFormatCannotHold) {
  const auto reasonOf = [](const CalibrationResult& result, Format format) {
    const Export exported = exportResult(result, format);
    EXPECT_EQ(exported.status, ExportStatus::kRefused);
    EXPECT_TRUE(exported.files.empty());
    return exported.reason;
  };
  CalibrationResult result = example(1);
  expectPart(reasonOf(result, Format::kKalibr), "cam1_color has k3 = 0.0");
  expectPart(reasonOf(result, Format::kKalibr), "--fixed k3");
  expectPart(reasonOf(example(2), Format::kIaiKinect2), "camera 'cam2' has the rational lens model");
  result.cameras[0].color_infrared.reset();
  expectPart(reasonOf(result, Format::kIaiKinect2), "'cam1' has no infrared calibration beside");
  result.cameras[0].hand_eye.reset();
  result.cameras[0].infrared.reset();
  expectPart(reasonOf(result, Format::kEasyHandEye2), "no camera has a pose on the robot");
  result.cameras[0].camera = "left eye";
  expectPart(reasonOf(result, Format::kUrdf), "'left eye' cannot name");
  result.cameras[0].camera = "a/../../b";
  expectPart(reasonOf(result, Format::kOpenCv), "holds a slash");
  result.cameras.clear();
  expectPart(reasonOf(result, Format::kOpenCv), "no camera");

  // Kalibr's chain needs every camera beside the one before: here one is in the cell, one on the flange.
  CalibrationResult apart = example(3);
  for (CameraResult& camera : apart.cameras) {
    camera.intrinsics.camera.lens = LensModel::kPlumbBob;
    camera.intrinsics.camera.parameters.conservativeResize(9);
    camera.intrinsics.camera.parameters[8] = camera.infrared->camera.parameters[8] = 0.0;
  }
  expectPart(reasonOf(apart, Format::kKalibr), "cam3_color does not stand beside cam2_infrared");
}

TEST(Export, StatesParentAndChildOfEveryPose) {
  const CalibrationResult result = example(1);
  const auto notesOf = [&](Format format) {
    std::string all;
    for (const std::string& note : exportResult(result, format).notes) all += note + "\n";
    return all;
  };
  expectPart(notesOf(Format::kRos2StaticTf), "cam1_link in base: calibrated, bMc");
  expectPart(notesOf(Format::kUrdf),
             "cam1_infrared_optical_frame in cam1_color_optical_frame: calibrated, cMi");
  expectPart(notesOf(Format::kVisp), "cam1_color_rPc.yaml: cam1_color_optical_frame in base");
  expectPart(notesOf(Format::kVisp), "cam1_ePo.yaml: board in tool0");
  expectPart(notesOf(Format::kEasyHandEye2), "cam1.calib: cam1_color_optical_frame in base");
  expectPart(notesOf(Format::kEasyHandEye2), "name its topmost frame with --driver, or tf has two");
  expectPart(notesOf(Format::kOpenCv),
             "cam1_infrared.yaml: cam1_infrared_optical_frame in base (parent_from_camera)");
  expectPart(notesOf(Format::kMrcal),
             "cam1_color.cameramodel: cam1_color_optical_frame, the reference is base");
  expectPart(notesOf(Format::kIaiKinect2), "take points of the infrared camera to the color camera");
  expectPart(notesOf(Format::kIaiKinect2), "calib_depth.yaml is an approximation: one shift of ");
}

TEST(Export, JsonIsTheResultItself) {
  const test::TemporaryFolder folder;
  const CalibrationResult result = example(2);
  writeExport(exportResult(result, Format::kJson), folder / "new/folder");
  EXPECT_EQ(session::resultJson(session::loadResult(folder / "new/folder/result.json")),
            session::resultJson(result));
  folder.write("file", "");
  expectPart(test::messageOf(ErrorKind::kBadData,
                             [&] { writeExport(exportResult(result, Format::kJson), folder / "file/sub"); }),
             "cannot write");
  EXPECT_THROW(writeExport(Export{}, folder.path()), std::invalid_argument);
}

}  // namespace
}  // namespace servocal::report
