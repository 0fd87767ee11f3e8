// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "errors.h"
#include "random_result.h"
#include "servocal/session/session.h"
#include "temporary_folder.h"

namespace servocal::session {
namespace {

using Json = nlohmann::ordered_json;

std::string slurp(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

class ResultReader : public ::testing::Test {
 protected:
  const test::TemporaryFolder folder_;
  const CalibrationResult result_ = test::RandomResult(5).make(3);

  std::string refusal(const Json& tree) const {
    const std::filesystem::path file = folder_.write("changed.json", tree.dump());
    return test::messageOf(ErrorKind::kBadData, [&] { loadResult(file); });
  }
};

TEST_F(ResultReader, WhatIsReadIsWrittenAgainByteByByte) {
  for (const char* name : {"result.json", "result.yaml"}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      saveResult(folder_ / name, test::RandomResult(seed).make(3));
      const std::string first = slurp(folder_ / name);
      saveResult(folder_ / name, loadResult(folder_ / name));
      EXPECT_EQ(slurp(folder_ / name), first) << name << ", seed " << seed;
    }
  }
}

// The other way round: a field that neither the writer nor the reader knows would pass the test above.
TEST_F(ResultReader, EveryFieldComesBack) {
  saveResult(folder_ / "result.yaml", result_);
  const CalibrationResult back = loadResult(folder_ / "result.yaml");
  EXPECT_EQ(back.schema_version, result_.schema_version);
  EXPECT_EQ(back.goal_met, result_.goal_met);
  EXPECT_EQ(back.missing, result_.missing);
  EXPECT_EQ(back.provenance, result_.provenance);
  EXPECT_EQ(boardKeys(back.board), boardKeys(result_.board));
  EXPECT_EQ(back.observations, result_.observations);
  EXPECT_EQ(back.motion_time_s, result_.motion_time_s);
  EXPECT_EQ(back.tilt_time_s, result_.tilt_time_s);
  const auto expectViews = [](const std::vector<ViewResidual>& a, const std::vector<ViewResidual>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_EQ(std::tie(a[i].observation_id, a[i].name, a[i].rms_px, a[i].used, a[i].reason, a[i].cause),
                std::tie(b[i].observation_id, b[i].name, b[i].rms_px, b[i].used, b[i].reason, b[i].cause));
    }
  };
  const auto expectIntrinsics = [&](const IntrinsicsResult& a, const IntrinsicsResult& b) {
    EXPECT_EQ(a.camera.lens, b.camera.lens);
    EXPECT_EQ(a.camera.width_px, b.camera.width_px);
    EXPECT_EQ(a.camera.height_px, b.camera.height_px);
    EXPECT_EQ(a.camera.parameters, b.camera.parameters);
    EXPECT_EQ(a.sigma, b.sigma);
    EXPECT_EQ(a.covariance, b.covariance);
    EXPECT_EQ(a.rms_px, b.rms_px);
    EXPECT_EQ(a.corners, b.corners);
    expectViews(a.views, b.views);
  };
  const auto expectHandEye = [&](const HandEyeSolution& a, const HandEyeSolution& b) {
    EXPECT_EQ(a.mount, b.mount);
    EXPECT_EQ(a.camera_pose.matrix(), b.camera_pose.matrix());
    EXPECT_EQ(a.board_pose.matrix(), b.board_pose.matrix());
    EXPECT_EQ(a.camera_sigma.head<3>(), b.camera_sigma.head<3>());
    EXPECT_EQ(a.board_sigma.head<3>(), b.board_sigma.head<3>());
    for (int i = 3; i < 6; ++i) {
      EXPECT_DOUBLE_EQ(a.camera_sigma[i], b.camera_sigma[i]);
      EXPECT_DOUBLE_EQ(a.board_sigma[i], b.board_sigma[i]);
    }
    EXPECT_EQ(a.rms_px, b.rms_px);
    EXPECT_EQ(a.robot_rms_m, b.robot_rms_m);
    EXPECT_DOUBLE_EQ(a.robot_rms_rad, b.robot_rms_rad);
    EXPECT_EQ(a.scatter_m, b.scatter_m);
    EXPECT_DOUBLE_EQ(a.scatter_rad, b.scatter_rad);
    EXPECT_EQ(a.symmetric_views, b.symmetric_views);
    EXPECT_EQ(a.resolved_turns, b.resolved_turns);
    EXPECT_EQ(a.resolved_flips, b.resolved_flips);
    expectViews(a.views, b.views);
  };
  const auto expectPair = [&](const CameraPair& a, const CameraPair& b) {
    EXPECT_EQ(a.first, b.first);
    EXPECT_EQ(a.second, b.second);
    EXPECT_EQ(a.first_by_second.matrix(), b.first_by_second.matrix());
    EXPECT_EQ(a.covariance, b.covariance);
    EXPECT_EQ(a.rms_px, b.rms_px);
    expectViews(a.views, b.views);
  };
  const auto expectCoverage = [](const CoverageSummary& a, const CoverageSummary& b) {
    EXPECT_EQ(std::tie(a.cells_x, a.cells_y, a.corners_per_cell, a.unreachable, a.corners_to_fill,
                       a.near_views, a.far_views, a.tilt_bins, a.out_of_reach),
              std::tie(b.cells_x, b.cells_y, b.corners_per_cell, b.unreachable, b.corners_to_fill,
                       b.near_views, b.far_views, b.tilt_bins, b.out_of_reach));
  };
  ASSERT_EQ(back.cameras.size(), result_.cameras.size());
  for (std::size_t i = 0; i < back.cameras.size(); ++i) {
    const CameraResult &a = back.cameras[i], &b = result_.cameras[i];
    EXPECT_EQ(a.camera, b.camera);
    expectIntrinsics(a.intrinsics, b.intrinsics);
    expectIntrinsics(a.intrinsics_with_outliers.value(), *b.intrinsics_with_outliers);
    expectHandEye(a.hand_eye.value(), *b.hand_eye);
    expectHandEye(a.hand_eye_with_outliers.value(), *b.hand_eye_with_outliers);
    EXPECT_EQ(a.board_scale.value().scale, b.board_scale->scale);
    EXPECT_EQ(a.board_scale->sigma, b.board_scale->sigma);
    EXPECT_EQ(a.notes, b.notes);
    expectCoverage(a.coverage.value(), *b.coverage);
    ASSERT_EQ(a.tilt_limits.size(), b.tilt_limits.size());
    for (std::size_t k = 0; k < a.tilt_limits.size(); ++k) {
      EXPECT_EQ(a.tilt_limits[k].stream, b.tilt_limits[k].stream);
      EXPECT_EQ(a.tilt_limits[k].direction, b.tilt_limits[k].direction);
      EXPECT_DOUBLE_EQ(a.tilt_limits[k].limit_rad, b.tilt_limits[k].limit_rad);
      EXPECT_EQ(a.tilt_limits[k].ended_by, b.tilt_limits[k].ended_by);
    }
    expectIntrinsics(a.infrared.value(), *b.infrared);
    expectHandEye(a.infrared_hand_eye.value(), *b.infrared_hand_eye);
    expectPair(a.color_infrared.value(), *b.color_infrared);
    const DepthResult &d = a.depth.value(), &e = *b.depth;
    EXPECT_EQ(d.model.camera.parameters, e.model.camera.parameters);
    EXPECT_EQ(d.model.nodes, e.model.nodes);
    EXPECT_EQ(d.model.wiggle, e.model.wiggle);
    EXPECT_EQ(std::tie(d.model.wiggle_from_m, d.model.wiggle_to_m),
              std::tie(e.model.wiggle_from_m, e.model.wiggle_to_m));
    EXPECT_EQ(d.sigma_m, e.sigma_m);
    EXPECT_EQ(d.sigma_at_m, e.sigma_at_m);
    EXPECT_EQ(
        std::tie(d.model.sensor, d.model.offset, d.model.slope, d.model.nodes_x, d.model.nodes_y,
                 d.model.near_m, d.model.far_m, d.rms_before_m, d.rms_after_m, d.views, d.patches, d.notes),
        std::tie(e.model.sensor, e.model.offset, e.model.slope, e.model.nodes_x, e.model.nodes_y,
                 e.model.near_m, e.model.far_m, e.rms_before_m, e.rms_after_m, e.views, e.patches, e.notes));
    expectCoverage(a.infrared_coverage.value(), *b.infrared_coverage);
    EXPECT_EQ(a.combined_views, b.combined_views);
    EXPECT_EQ(a.affine_baseline.value().bAc, b.affine_baseline->bAc);
    EXPECT_EQ(a.affine_baseline->rms_m, b.affine_baseline->rms_m);
    EXPECT_EQ(a.affine_baseline->inliers, b.affine_baseline->inliers);
    EXPECT_EQ(a.affine_baseline->points, b.affine_baseline->points);
    ASSERT_TRUE(a.held_out && b.held_out);
    EXPECT_EQ(a.held_out->views, b.held_out->views);
    EXPECT_EQ(a.held_out->rms_px, b.held_out->rms_px);
    EXPECT_EQ(a.held_out->rms_m, b.held_out->rms_m);
    EXPECT_EQ(a.time_offset_s, b.time_offset_s);
    EXPECT_EQ(a.time_offset_sigma_s, b.time_offset_sigma_s);
  }
  ASSERT_EQ(back.camera_pairs.size(), result_.camera_pairs.size());
  for (std::size_t i = 0; i < back.camera_pairs.size(); ++i) {
    expectPair(back.camera_pairs[i], result_.camera_pairs[i]);
  }
}

TEST_F(ResultReader, EveryFieldOfTheJointEstimateComesBack) {
  saveResult(folder_ / "result.yaml", result_);
  const CalibrationResult read = loadResult(folder_ / "result.yaml");
  EXPECT_EQ(read.joint_problem, result_.joint_problem);
  const JointResult &back = read.joint.value(), &joint = *result_.joint;
  const auto expectProjection = [](const ProjectionMap& a, const ProjectionMap& b) {
    EXPECT_EQ(std::tie(a.cells_x, a.cells_y, a.sigma_px, a.worst_px, a.rms_px),
              std::tie(b.cells_x, b.cells_y, b.sigma_px, b.worst_px, b.rms_px));
  };
  ASSERT_EQ(back.cameras.size(), joint.cameras.size());
  for (std::size_t i = 0; i < joint.cameras.size(); ++i) {
    const JointCameraResult &a = back.cameras[i], &b = joint.cameras[i];
    EXPECT_EQ(std::tie(a.camera, a.stream, a.rms_px, a.corner_scale, a.views, a.range_m),
              std::tie(b.camera, b.stream, b.rms_px, b.corner_scale, b.views, b.range_m));
    EXPECT_EQ(a.model.parameters, b.model.parameters);
    EXPECT_EQ(a.sigma, b.sigma);
    EXPECT_EQ(a.pose.matrix(), b.pose.matrix());
    EXPECT_EQ(a.pose_covariance, b.pose_covariance);
    expectProjection(a.at_infinity, b.at_infinity);
    expectProjection(a.at_range, b.at_range);
    ASSERT_EQ(a.halves.has_value(), b.halves.has_value());
    if (a.halves) {
      EXPECT_EQ(std::tie(a.halves->rms_px, a.halves->claimed_px), std::tie(b.halves->rms_px, b.halves->claimed_px));
    }
    const WorkspaceMap &map = a.workspace, &other = b.workspace;
    EXPECT_EQ(std::tie(map.cells_x, map.cells_y, map.cells_z, map.sigma_m, map.worst_m, map.rms_m, map.seen),
              std::tie(other.cells_x, other.cells_y, other.cells_z, other.sigma_m, other.worst_m, other.rms_m,
                       other.seen));
  }
  EXPECT_EQ(back.mount, joint.mount);
  ASSERT_EQ(back.pairs.size(), joint.pairs.size());
  for (std::size_t i = 0; i < joint.pairs.size(); ++i) {
    const JointPair &a = back.pairs[i], &b = joint.pairs[i];
    EXPECT_EQ(std::tie(a.first, a.first_stream, a.second, a.second_stream, a.worst_m, a.rms_m, a.seen),
              std::tie(b.first, b.first_stream, b.second, b.second_stream, b.worst_m, b.rms_m, b.seen));
    EXPECT_EQ(a.first_by_second.matrix(), b.first_by_second.matrix());
    EXPECT_EQ(a.covariance, b.covariance);
  }
  EXPECT_EQ(back.board_pose.matrix(), joint.board_pose.matrix());
  EXPECT_EQ(back.board_sigma.head<3>(), joint.board_sigma.head<3>());
  for (int i = 3; i < 6; ++i) EXPECT_DOUBLE_EQ(back.board_sigma[i], joint.board_sigma[i]);
  EXPECT_EQ(std::tie(back.board_scale_x, back.board_scale_y, back.board_bow_x_m, back.board_bow_y_m,
                     back.robot_sigma_m, back.declared_sigma_m, back.robot_terms, back.model, back.open,
                     back.faults, back.notes),
            std::tie(joint.board_scale_x, joint.board_scale_y, joint.board_bow_x_m, joint.board_bow_y_m,
                     joint.robot_sigma_m, joint.declared_sigma_m, joint.robot_terms, joint.model, joint.open,
                     joint.faults, joint.notes));
  EXPECT_DOUBLE_EQ(back.robot_sigma_rad, joint.robot_sigma_rad);
  EXPECT_DOUBLE_EQ(back.declared_sigma_rad, joint.declared_sigma_rad);
  const JointHeldOut &held = back.held_out.value(), &out = *joint.held_out;
  EXPECT_EQ(std::tie(held.views, held.rms_px, held.rms_m, held.z), std::tie(out.views, out.rms_px, out.rms_m, out.z));
}

// Files of the version before the joint estimate.
TEST_F(ResultReader, ReadsSchemaTwo) {
  Json old = Json::parse(resultJson(result_));
  old["schema_version"] = 2;
  old.erase("joint");
  old.erase("joint_problem");
  for (Json& camera : old["cameras"]) {
    camera["coverage"].erase("out_of_reach");
    camera["infrared_coverage"].erase("out_of_reach");
  }
  const CalibrationResult back = loadResult(folder_.write("old.json", old.dump()));
  EXPECT_EQ(back.cameras.size(), result_.cameras.size());
  EXPECT_FALSE(back.joint.has_value());
  EXPECT_TRUE(back.cameras[0].coverage->out_of_reach.empty());
}

TEST_F(ResultReader, WhatIsAbsentOrNotFiniteStaysSo) {
  CalibrationResult small = result_;
  small.cameras.resize(1);
  small.camera_pairs.clear();
  CameraResult plain;
  plain.camera = "cam1";
  plain.intrinsics.camera = small.cameras[0].intrinsics.camera;  // given: no sigma
  plain.hand_eye = small.cameras[0].hand_eye;
  plain.hand_eye->board_sigma.setConstant(std::numeric_limits<double>::quiet_NaN());
  plain.depth = small.cameras[0].depth;  // without an infrared result beside it
  small.cameras = {plain};
  saveResult(folder_ / "result.yaml", small);
  const CameraResult back = loadResult(folder_ / "result.yaml").cameras.at(0);
  EXPECT_EQ(back.intrinsics.sigma.size(), 0);
  EXPECT_TRUE(back.hand_eye->board_sigma.array().isNaN().all());
  EXPECT_EQ(back.depth.value().model.camera.parameters, plain.depth->model.camera.parameters);
  EXPECT_FALSE(back.infrared || back.color_infrared || back.coverage || back.affine_baseline ||
               back.time_offset_s || back.board_scale || back.intrinsics_with_outliers ||
               back.hand_eye_with_outliers);
}

// Every key of the file is either optional by the schema, or its absence is an error that names it.
TEST_F(ResultReader, EveryMissingKeyIsNamed) {
  const Json whole = Json::parse(resultJson(test::RandomResult(5).make(2)));
  const std::set<std::string> optional = {
      "camera_pairs",      "with_outliers",     "hand_eye",       "board_scale",     "coverage",
      "tilt_limits",       "infrared",          "depth",          "covariance",      "color_infrared",
      "infrared_hand_eye", "infrared_coverage", "combined_views", "affine_baseline", "time_offset_s", "held_out",
      "joint",             "joint_problem",     "out_of_reach",   "halves",
      "pairs"};
  int removed = 0;
  const std::function<void(const Json&, const Json::json_pointer&)> visit =
      [&](const Json& node, const Json::json_pointer& at) {
        if (node.is_array()) {
          for (std::size_t i = 0; i < std::min<std::size_t>(node.size(), 1); ++i) visit(node[i], at / i);
        }
        if (!node.is_object() || at.to_string().find("/board/") != std::string::npos) return;
        for (const auto& [key, value] : node.items()) {
          visit(value, at / key);
          if (optional.count(key) != 0 || (at.to_string() == "/board") ||
              (key == "notes" && at.to_string() == "/cameras/0") || (key == "mount" && at.to_string() == "/joint")) {
            continue;
          }
          Json changed = whole;
          changed[at].erase(key);
          const std::string message = refusal(changed);
          test::expectPart(message, "'" + key + "'");
          test::expectPart(message, (folder_ / "changed.json").string());
          ++removed;
        }
      };
  visit(whole, Json::json_pointer());
  EXPECT_GT(removed, 100);
}

TEST_F(ResultReader, ContradictionsAndStrangersAreRefused) {
  const Json whole = Json::parse(resultJson(result_));
  const auto expectRefusal = [&](const char* where, const Json& value, const std::string& part) {
    Json changed = whole;
    changed[Json::json_pointer(where)] = value;
    test::expectPart(refusal(changed), part);
  };
  expectRefusal("/schema_version", 1, "'schema_version' is 1, this program reads 2 to 3; solve the session again");
  expectRefusal("/cameras/0/colour", 1, "unknown key 'colour'");
  expectRefusal("/cameras/0/intrinsics/views_used", 3, "'views_used' contradicts 'views', of which 2");
  expectRefusal("/cameras/0/intrinsics/parameters/fx_px/value", 1.0,
                "'camera_matrix_px' contradicts 'parameters'");
  expectRefusal("/cameras/0/intrinsics/parameters/k3/value", 1.0, "'distortion_coefficients' contradicts");
  expectRefusal("/cameras/0/intrinsics/parameters/k3/value", nullptr, "'value'");
  expectRefusal("/cameras/0/hand_eye/camera_pose/translation_m/1", 7.0,
                "'matrix' contradicts 'translation_m'");
  expectRefusal("/cameras/0/hand_eye/camera_pose/quaternion_xyzw", {0, 0, 0, 1},
                "contradicts 'quaternion_xyzw'");
  expectRefusal("/cameras/0/hand_eye/camera_pose/child_frame", "cam2_color", "allowed: cam1_color");
  expectRefusal("/cameras/0/hand_eye/mount", "flange", "allowed: eMc");
  expectRefusal("/cameras/0/depth/nodes", {1, 2, 3}, "'nodes' must be a list of 6 numbers");
  expectRefusal("/camera_pairs/0/pose/child_frame", "left", "'child_frame' is 'left'");
  expectRefusal("/joint/cameras/0/at_range/sigma_px", {1, 2}, "'sigma_px' must be a list of 6 numbers");
  expectRefusal("/joint/cameras/0/workspace/cells_z", 4, "'sigma_m' must be a list of 16 numbers");
  expectRefusal("/joint/cameras/0/pose/name", "eMc", "allowed: bMc");
  expectRefusal("/joint/colour", 1, "unknown key 'colour'");
  expectRefusal("/goal_met", "perhaps", "'goal_met' must be true or false");
  test::expectPart(test::messageOf(ErrorKind::kBadData, [&] { loadResult(folder_ / "none.yaml"); }),
                   "none.yaml': there is no such file");
}

}  // namespace
}  // namespace servocal::session
