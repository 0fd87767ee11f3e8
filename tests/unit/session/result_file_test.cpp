// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "errors.h"
#include "servocal/session/session.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

CalibrationResult exampleResult() {
  CalibrationResult result;
  result.goal_met = false;
  result.missing = {"3 of 40 cells are not filled: \"corner\""};
  result.provenance = "servocal 0.1.0, seed 7";
  CameraResult camera;
  camera.camera = "cam1";
  camera.intrinsics.camera.lens = LensModel::kPlumbBob;
  camera.intrinsics.camera.width_px = 1920;
  camera.intrinsics.camera.height_px = 1080;
  camera.intrinsics.camera.parameters.resize(9);
  camera.intrinsics.camera.parameters << 1066.0, 3200.0 / 3, 959.5, 539.5, 0.09, -0.12, 6e-05, -4e-18, 0;
  camera.intrinsics.sigma = Eigen::VectorXd::Constant(9, 1.0 / 7);
  camera.intrinsics.covariance = Eigen::MatrixXd::Identity(9, 9) / 49;
  camera.intrinsics.rms_px = 0.2;
  camera.intrinsics.views = {{1, "a.png", 0.1, true, ""}, {2, "b.png", 9, false, "board not found"}};
  HandEyeSolution hand_eye;
  hand_eye.camera_pose = Pose<Base, Color>::fromRotationVector({0, 0, 3.0}, {1, 0.1, 1.0 / 3}).isometry();
  hand_eye.board_pose = Eigen::Isometry3d::Identity();
  hand_eye.camera_sigma << 1, 2, 3, 0.1, 0.2, 0.3;
  hand_eye.board_sigma.setConstant(std::numeric_limits<double>::quiet_NaN());
  camera.hand_eye = hand_eye;
  camera.tilt_limits = {{"roll+", 0.5, "detection"}};
  result.cameras = {camera};
  return result;
}

std::string slurp(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

TEST(ResultFile, JsonSaysEverythingExactly) {
  const test::TemporaryFolder folder;
  saveResult(folder / "new/result.json", exampleResult());
  const auto tree = nlohmann::json::parse(slurp(folder / "new/result.json"));
  EXPECT_EQ(tree["schema_version"], 3);
  EXPECT_EQ(tree["goal_met"], false);
  const auto& camera = tree["cameras"][0];
  EXPECT_EQ(camera["intrinsics"]["parameters"]["fy_px"]["value"].get<double>(), 3200.0 / 3);
  EXPECT_EQ(camera["intrinsics"]["parameters"]["p2"]["value"].get<double>(), -4e-18);
  EXPECT_EQ(camera["intrinsics"]["parameters"]["k1"]["sigma"].get<double>(), 1.0 / 7);
  EXPECT_EQ(camera["intrinsics"]["views_used"], 1);
  EXPECT_EQ(camera["intrinsics"]["views"][1]["reason"], "board not found");
  const auto& pose = camera["hand_eye"]["camera_pose"];
  EXPECT_EQ(pose["name"], "bMc");
  EXPECT_EQ(pose["parent_frame"], "base");
  EXPECT_EQ(pose["child_frame"], "cam1_color");
  EXPECT_EQ(pose["translation_m"][2].get<double>(), 1.0 / 3);
  EXPECT_EQ(pose["matrix"][0][3].get<double>(), 1.0);
  EXPECT_NEAR(pose["quaternion_xyzw"][2].get<double>(), std::sin(1.5), 1e-15);
  EXPECT_NEAR(pose["rotation_sigma_deg"][0].get<double>(), 5.729577951308232, 1e-14);
  EXPECT_TRUE(camera["hand_eye"]["board_pose"]["translation_sigma_m"][0].is_null());
  EXPECT_EQ(resultJson(exampleResult()), slurp(folder / "new/result.json"));
}

// Read by another YAML reader, the YAML file must be the same tree, number for number.
TEST(ResultFile, YamlIsTheSameTree) {
  const test::TemporaryFolder folder;
  saveResult(folder / "result.yaml", exampleResult());
  const std::function<void(const YAML::Node&, const nlohmann::json&, const std::string&)> compare =
      [&](const YAML::Node& yaml, const nlohmann::json& json, const std::string& where) {
        if (json.is_object()) {
          ASSERT_TRUE(yaml.IsMap()) << where;
          ASSERT_EQ(yaml.size(), json.size()) << where;
          for (const auto& [key, value] : json.items()) compare(yaml[key], value, where + "." + key);
        } else if (json.is_array()) {
          ASSERT_TRUE(yaml.IsSequence()) << where;
          ASSERT_EQ(yaml.size(), json.size()) << where;
          for (std::size_t i = 0; i < json.size(); ++i) compare(yaml[i], json[i], where + "[]");
        } else if (json.is_number()) {
          EXPECT_EQ(yaml.as<double>(), json.get<double>()) << where;
          if (json.is_number_float()) {
            EXPECT_NE(yaml.Scalar().find('.'), std::string::npos) << where;
          }
        } else if (json.is_boolean()) {
          EXPECT_EQ(yaml.as<bool>(), json.get<bool>()) << where;
        } else if (json.is_null()) {
          EXPECT_TRUE(yaml.IsNull()) << where;
        } else {
          EXPECT_EQ(yaml.as<std::string>(), json.get<std::string>()) << where;
        }
      };
  compare(YAML::LoadFile((folder / "result.yaml").string()),
          nlohmann::json::parse(resultJson(exampleResult())), "");
}

TEST(ResultFile, GivenIntrinsicsCarryNoSigma) {
  CalibrationResult result = exampleResult();
  result.cameras[0].intrinsics.sigma.resize(0);
  const auto tree = nlohmann::json::parse(resultJson(result));
  EXPECT_EQ(tree["cameras"][0]["intrinsics"]["source"], "given");
  EXPECT_FALSE(tree["cameras"][0]["intrinsics"]["parameters"]["fx_px"].contains("sigma"));
}

TEST(ResultFile, RefusesWhatItCannotWrite) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(saveResult(folder / "result.txt", exampleResult()), std::invalid_argument);
  folder.write("file", "");
  test::expectPart(
      test::messageOf(ErrorKind::kBadData, [&] { saveResult(folder / "file/result.yaml", exampleResult()); }),
      "cannot make folder");
  std::filesystem::create_directory(folder / "taken.yaml");
  test::expectPart(
      test::messageOf(ErrorKind::kBadData, [&] { saveResult(folder / "taken.yaml", exampleResult()); }),
      "cannot write '" + (folder / "taken.yaml").string());
  EXPECT_FALSE(std::filesystem::exists(folder / "taken.yaml.tmp"));
}

}  // namespace
}  // namespace servocal::session
