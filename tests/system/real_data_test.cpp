// SPDX-License-Identifier: GPL-3.0-or-later
// Real recordings, each solved by one command of servocal-solve. They are not part of the project: the
// environment variable SERVOCAL_TEST_DATA names their folder, and without it these tests are skipped.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "run_program.h"
#include "servocal/procedure/recorded.h"

namespace servocal {
namespace {

using Json = nlohmann::json;

/// What is known of a recording: "measured" by OpenCV 4.6, "published" by the source.
struct Reference {
  const char* manifest;
  int views;                     ///< At least these many.
  std::optional<double> rms_px;  ///< At most 1.02 times this, to the digits it is given in.
  std::vector<std::pair<const char*, double>> parameters;
};

std::ostream& operator<<(std::ostream& out, const Reference& reference) { return out << reference.manifest; }

std::optional<std::string> dataFolder() {
  const char* folder = std::getenv("SERVOCAL_TEST_DATA");
  return folder != nullptr && *folder != '\0' ? std::optional<std::string>(folder) : std::nullopt;
}

Json solve(const std::string& manifest, const std::string& data) {
  const test::ProgramRun run = test::runProgram(std::string(SERVOCAL_SOLVE) + " " SERVOCAL_MANIFESTS "/" +
                                                manifest + ".yaml --json --root " + test::shellWord(data));
  EXPECT_EQ(run.exit_code, 0) << run.err;
  return run.exit_code == 0 ? Json::parse(run.out) : Json();
}

class RealData : public ::testing::TestWithParam<Reference> {};

TEST_P(RealData, IntrinsicsAreAsGoodAsTheReference) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const Reference& reference = GetParam();
  const Json result = solve(reference.manifest, *data);
  ASSERT_FALSE(result.is_null());
  const Json& intrinsics = result["cameras"][0]["intrinsics"];
  EXPECT_GE(intrinsics["views_used"].get<int>(), reference.views);
  const double rms_px = intrinsics["rms_px"];
  if (reference.rms_px) {
    EXPECT_LE(rms_px, 1.02 * *reference.rms_px);
  }
  for (const auto& [name, value] : reference.parameters) {
    const Json& parameter = intrinsics["parameters"][name];
    const double sigma = parameter["sigma"], difference = parameter["value"].get<double>() - value;
    // The reference has an uncertainty of its own, from the same views with its own corners: larger than
    // ours in the ratio of the residuals.
    const double ratio = reference.rms_px ? *reference.rms_px / rms_px : 1.0;
    EXPECT_LE(std::abs(difference), 3.0 * sigma * std::hypot(1.0, ratio))
        << name << " = " << parameter["value"] << " +- " << sigma << ", reference " << value;
    std::printf("%s %s: %.4f +- %.4f, reference %.4f, %.1f of our own standard deviations away\n",
                reference.manifest, name, parameter["value"].get<double>(), sigma, value,
                std::abs(difference) / sigma);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Recordings, RealData,
    ::testing::Values(Reference{"yz_eye_in_hand",
                                6,
                                0.122,
                                {{"fx_px", 641.4}, {"fy_px", 641.0}, {"cx_px", 475.3}, {"cy_px", 290.3}}},
                      Reference{"opencv_left",
                                13,
                                0.195,
                                {{"fx_px", 532.8}, {"fy_px", 533.0}, {"cx_px", 342.5}, {"cy_px", 233.9}}},
                      Reference{"opencv_right", 13, 0.207, {}}, Reference{"sony", 13, 0.162, {}},
                      Reference{"sony_published",
                                13,
                                std::nullopt,
                                {{"fx_px", 701.0117},
                                 {"fy_px", 698.6538},
                                 {"cx_px", 308.4552},
                                 {"cy_px", 246.8430},
                                 {"k1", -0.25559},
                                 {"k2", 0.09997}}},
                      Reference{"bumblebee_left",
                                11,
                                0.10,
                                {{"fx_px", 524.6141},
                                 {"fy_px", 526.9202},
                                 {"cx_px", 312.4509},
                                 {"cy_px", 247.4016},
                                 {"k1", -0.36254},
                                 {"k2", 0.17533}}},
                      Reference{"bumblebee_right",
                                11,
                                0.10,
                                {{"fx_px", 526.4373},
                                 {"fy_px", 528.6525},
                                 {"cx_px", 318.4041},
                                 {"cy_px", 245.9350},
                                 {"k1", -0.35300},
                                 {"k2", 0.16297}}},
                      Reference{"mrpt_left", 4, 0.16, {}}, Reference{"yz_aruco_grid", 7, 0.90, {}},
                      Reference{"yz_charuco",
                                7,
                                0.330,
                                {{"fx_px", 790.7}, {"fy_px", 796.0}, {"cx_px", 510.8}, {"cy_px", 379.4}}},
                      Reference{"boofcv_circles", 6, 0.50, {}},
                      Reference{"rct_10x10",
                                15,
                                std::nullopt,
                                {{"fx_px", 542.3}, {"fy_px", 543.5}, {"cx_px", 320.5}, {"cy_px", 226.0}}}),
    [](const auto& set) { return std::string(set.param.manifest); });

// Published limit of the source: hand-eye RMS below 1 px. Measured: eMc (94.5, -7.9, 133.4) mm, scatter of
// the closed form 0.84 mm and 0.16 degrees.
TEST(RealDataHandEye, EyeInHandAgreesWithTheReference) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const Json result = solve("yz_eye_in_hand", *data);
  ASSERT_FALSE(result.is_null());
  const Json& hand_eye = result["cameras"][0]["hand_eye"];
  EXPECT_EQ(hand_eye["mount"], "flange");
  EXPECT_EQ(hand_eye["views_used"], 6);
  EXPECT_LT(hand_eye["rms_px"].get<double>(), 1.0);
  EXPECT_LT(hand_eye["scatter_m"].get<double>(), 0.0015);
  EXPECT_LT(hand_eye["scatter_deg"].get<double>(), 0.25);
  EXPECT_EQ(hand_eye["camera_pose"]["name"], "eMc");
  const double reference_m[3] = {0.0945, -0.0079, 0.1334};
  for (std::size_t i = 0; i < 3; ++i) {
    // Six views: two honest solves differ by millimetres along the optical axis, where the intrinsics decide.
    EXPECT_NEAR(hand_eye["camera_pose"]["translation_m"][i].get<double>(), reference_m[i], 0.006)
        << "axis " << i;
  }
}

/// Two cameras that took their images together; the reference's translation may be of either direction.
struct PairReference {
  const char* manifest;
  int views;
  double baseline_m, tolerance_m;
  double rms_px;
};

class RealPair : public ::testing::TestWithParam<PairReference> {};

TEST_P(RealPair, BaselineIsTheReferences) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const PairReference& reference = GetParam();
  const Json result = solve(reference.manifest, *data);
  ASSERT_FALSE(result.is_null());
  ASSERT_EQ(result["camera_pairs"].size(), 1u);
  const Json& pair = result["camera_pairs"][0];
  EXPECT_EQ(pair["pose"]["parent_frame"], "left_color");
  EXPECT_EQ(pair["pose"]["child_frame"], "right_color");
  EXPECT_EQ(pair["views_used"], reference.views);
  EXPECT_LE(pair["rms_px"].get<double>(), reference.rms_px);
  const auto t = pair["pose"]["translation_m"].get<std::vector<double>>();
  EXPECT_NEAR(std::hypot(t[0], t[1], t[2]), reference.baseline_m, reference.tolerance_m);
  EXPECT_GT(t[0], 0.0);  // The right one is to the right.
}

// opencv_stereo measured with stereoCalibrate, -83.2 mm to a tenth, 0.217 px; Bumblebee2's published baseline,
// which with corners paired naively, without its half turns, would leave 22 px.
INSTANTIATE_TEST_SUITE_P(Recordings, RealPair,
                         ::testing::Values(PairReference{"opencv_stereo", 13, 0.0832, 0.0002, 0.217},
                                           PairReference{"bumblebee_stereo", 11, 0.12005, 0.0003, 0.10}),
                         [](const auto& set) { return std::string(set.param.manifest); });

// Measured: bMc (576, 574, 402) mm; board poses spread by 5.4 mm after the closed form. Published limit: 2 px.
TEST(RealDataHandEye, OneMarkerOnTheArm) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const Json result = solve("yz_eye_to_hand", *data);
  ASSERT_FALSE(result.is_null());
  const Json& hand_eye = result["cameras"][0]["hand_eye"];
  EXPECT_EQ(hand_eye["views_used"], 8);
  EXPECT_LT(hand_eye["rms_px"].get<double>(), 2.0);
  EXPECT_LT(hand_eye["scatter_m"].get<double>(), 0.0054);
  const double reference_m[3] = {0.576, 0.574, 0.402};
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR(hand_eye["camera_pose"]["translation_m"][i].get<double>(), reference_m[i], 0.0054) << "axis " << i;
}

// Measured: 20 of 20, board poses spread by 1.7 mm and 1.0 degree.
TEST(RealDataHandEye, CirclesLitFromBehind) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const Json result = solve("zhangnatha", *data);
  ASSERT_FALSE(result.is_null());
  const Json& hand_eye = result["cameras"][0]["hand_eye"];
  EXPECT_EQ(hand_eye["views_used"], 20);
  EXPECT_LT(hand_eye["scatter_m"].get<double>(), 0.0017);
  EXPECT_LT(hand_eye["scatter_deg"].get<double>(), 1.0);
}

// Published: robot and camera agree only to 12 mm and 2.1 degrees.
TEST(RealDataHandEye, CirclesWithABiggerCorner) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const Json result = solve("rct_10x10", *data);
  ASSERT_FALSE(result.is_null());
  const Json& hand_eye = result["cameras"][0]["hand_eye"];
  EXPECT_EQ(hand_eye["views_used"], 15);
  EXPECT_LT(hand_eye["scatter_m"].get<double>(), 0.012);
  EXPECT_LT(hand_eye["scatter_deg"].get<double>(), 2.1);
}

std::vector<std::size_t> cornersPerImage(const std::string& manifest, const std::string& data) {
  std::vector<std::size_t> counts;
  const auto images = session::loadImageSet(SERVOCAL_MANIFESTS "/" + manifest + ".yaml", data);
  for (const Observation& observation : procedure::detectImages(images))
    counts.push_back(observation.views.empty() ? 0 : observation.views[0].detection.corners.size());
  return counts;
}

// OpenCV's own detectors of tags and ChArUco corners on the same images.
TEST(RealDataDetection, AtLeastAsManyCornersAsTheReference) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  const std::vector<std::pair<const char*, std::vector<std::size_t>>> references = {
      {"yz_aprilgrid", {4 * 35, 4 * 33, 4 * 33, 4 * 36}}, {"azure_color", {87}}, {"azure_infrared", {94}}};
  for (const auto& [manifest, reference] : references) {
    const auto counts = cornersPerImage(manifest, *data);
    ASSERT_EQ(counts.size(), reference.size()) << manifest;
    for (std::size_t k = 0; k < counts.size(); ++k) EXPECT_GE(counts[k], reference[k]) << manifest << " " << k;
  }
}

// Four cameras of one kind in one folder: no common intrinsics, but the boards count.
TEST(RealDataDetection, CaliscopeBoards) {
  const auto data = dataFolder();
  if (!data) GTEST_SKIP() << "SERVOCAL_TEST_DATA is not set";
  int boards = 0;
  for (const Observation& observation :
       procedure::detectImages(session::loadImageSet(SERVOCAL_MANIFESTS "/caliscope.yaml", *data))) {
    if (!observation.views.empty()) ++boards;
  }
  EXPECT_GE(boards, 7);
}

}  // namespace
}  // namespace servocal
