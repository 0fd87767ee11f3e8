// SPDX-License-Identifier: GPL-3.0-or-later
#include <stdexcept>

#include "durable_file.h"
#include "result_keys.h"
#include "result_tree.h"
#include "servocal/session/session.h"
#include "yaml_text.h"

namespace servocal::session {
namespace {

Json boardTree(const BoardSpec& board) {
  Json tree;
  for (const auto& [key, value] : boardKeys(board)) tree[key] = Json::parse(value);
  return tree;
}

Json viewsTree(const std::vector<ViewResidual>& views) {
  Json tree = Json::array();
  for (const ViewResidual& view : views) {
    tree.push_back({{"observation_id", view.observation_id},
                    {"name", view.name},
                    {"rms_px", view.rms_px},
                    {"used", view.used},
                    {"cause", toString(view.cause)},
                    {"reason", view.reason}});
  }
  return tree;
}

int usedViews(const std::vector<ViewResidual>& views) {
  int used = 0;
  for (const ViewResidual& view : views) used += view.used ? 1 : 0;
  return used;
}

Json intrinsicsTree(const IntrinsicsResult& intrinsics) {
  const bool solved = intrinsics.sigma.size() == intrinsics.camera.parameters.size();
  Json tree = {{"source", solved ? "solved" : "given"}};
  tree.update(cameraModelTree(intrinsics.camera, solved ? intrinsics.sigma : Eigen::VectorXd()));
  if (!solved) return tree;
  tree["rms_px"] = intrinsics.rms_px;
  tree["corners"] = intrinsics.corners;
  tree["views_used"] = usedViews(intrinsics.views);
  if (intrinsics.covariance.size() > 0) tree["covariance"] = matrix(intrinsics.covariance);
  tree["views"] = viewsTree(intrinsics.views);
  return tree;
}

Json handEyeTree(const HandEyeSolution& solution, const std::string& camera, Stream stream) {
  return {{"mount", solution.mount == Mount::kFixed ? "fixed" : "flange"},
          {"camera_pose", poseTree(cameraPoseNames(solution.mount, camera, stream), solution.camera_pose,
                                   solution.camera_sigma)},
          {"board_pose", poseTree(boardPoseNames(solution.mount), solution.board_pose, solution.board_sigma)},
          {"rms_px", solution.rms_px},
          {"robot_correction_rms_m", solution.robot_rms_m},
          {"robot_correction_rms_deg", solution.robot_rms_rad * kDegPerRad},
          {"scatter_m", solution.scatter_m},
          {"scatter_deg", solution.scatter_rad * kDegPerRad},
          {"symmetric_views", solution.symmetric_views},
          {"resolved_turns", solution.resolved_turns},
          {"resolved_flips", solution.resolved_flips},
          {"views_used", usedViews(solution.views)},
          {"views", viewsTree(solution.views)}};
}

Json coverageTree(const CoverageSummary& coverage) {
  Json tree = {{"cells_x", coverage.cells_x},
               {"cells_y", coverage.cells_y},
               {"corners_to_fill", coverage.corners_to_fill},
               {"corners_per_cell", coverage.corners_per_cell},
               {"unreachable", coverage.unreachable},
               {"near_views", coverage.near_views},
               {"far_views", coverage.far_views},
               {"tilt_bins", Json::array()}};
  for (const auto& [bin, views] : coverage.tilt_bins)
    tree["tilt_bins"].push_back({{"bin", bin}, {"views", views}});
  tree["out_of_reach"] = coverage.out_of_reach;
  return tree;
}

Json pairTree(const CameraPair& pair, const PoseNames& names) {
  return {{"pose", poseTree(names, pair.first_by_second, pair.covariance.diagonal().cwiseSqrt())},
          {"covariance", matrix(pair.covariance)},
          {"rms_px", pair.rms_px},
          {"views_used", usedViews(pair.views)},
          {"views", viewsTree(pair.views)}};
}

Json depthTree(const DepthResult& depth, const std::optional<IntrinsicsResult>& infrared) {
  const DepthModel& model = depth.model;
  Json tree = {{"sensor", toString(model.sensor)},
               {"offset", model.offset},
               {"slope", model.slope},
               {"nodes_x", model.nodes_x},
               {"nodes_y", model.nodes_y},
               {"nodes", list(model.nodes)},
               {"near_m", model.near_m},
               {"far_m", model.far_m},
               {"rms_before_m", depth.rms_before_m},
               {"rms_after_m", depth.rms_after_m},
               {"sigma_m", list(depth.sigma_m)},
               {"sigma_at_m", list(depth.sigma_at_m)},
               {"views", depth.views},
               {"patches", depth.patches},
               {"notes", depth.notes}};
  if (model.wiggle.size() > 0) {
    tree["wiggle"] = list(model.wiggle);
    tree["wiggle_from_m"] = model.wiggle_from_m;
    tree["wiggle_to_m"] = model.wiggle_to_m;
  }
  if (!infrared || !sameModel(infrared->camera, model.camera))
    tree["camera"] = cameraModelTree(model.camera, {});
  return tree;
}

Json tiltTree(const std::vector<TiltLimit>& limits) {
  Json tree = Json::array();
  for (const TiltLimit& limit : limits) {
    tree.push_back({{"stream", toString(limit.stream)},
                    {"direction", limit.direction},
                    {"limit_deg", limit.limit_rad * kDegPerRad},
                    {"ended_by", limit.ended_by}});
  }
  return tree;
}

void addInfrared(Json& tree, const CameraResult& camera) {
  if (camera.infrared) tree["infrared"] = intrinsicsTree(*camera.infrared);
  if (camera.infrared_hand_eye) {
    tree["infrared_hand_eye"] = handEyeTree(*camera.infrared_hand_eye, camera.camera, Stream::kInfrared);
  }
  if (camera.color_infrared) {
    tree["color_infrared"] = pairTree(*camera.color_infrared, colorInfraredNames(camera.camera));
  }
  if (camera.depth) tree["depth"] = depthTree(*camera.depth, camera.infrared);
  if (camera.infrared_coverage) tree["infrared_coverage"] = coverageTree(*camera.infrared_coverage);
  if (camera.combined_views != 0) tree["combined_views"] = camera.combined_views;
}

Json cameraTree(const CameraResult& camera) {
  Json tree = {{"camera", camera.camera}, {"intrinsics", intrinsicsTree(camera.intrinsics)}};
  if (camera.intrinsics_with_outliers) {
    tree["intrinsics"]["with_outliers"] = intrinsicsTree(*camera.intrinsics_with_outliers);
  }
  if (camera.hand_eye) tree["hand_eye"] = handEyeTree(*camera.hand_eye, camera.camera, Stream::kColor);
  if (camera.hand_eye && camera.hand_eye_with_outliers) {
    tree["hand_eye"]["with_outliers"] =
        handEyeTree(*camera.hand_eye_with_outliers, camera.camera, Stream::kColor);
  }
  if (camera.board_scale) {
    tree["board_scale"] = {{"scale", camera.board_scale->scale}, {"sigma", camera.board_scale->sigma}};
  }
  if (!camera.notes.empty()) tree["notes"] = camera.notes;
  if (camera.coverage) tree["coverage"] = coverageTree(*camera.coverage);
  if (!camera.tilt_limits.empty()) tree["tilt_limits"] = tiltTree(camera.tilt_limits);
  addInfrared(tree, camera);
  if (const auto& affine = camera.affine_baseline) {
    tree["affine_baseline"] = {{"matrix", matrix(affine->bAc)},
                               {"rms_m", affine->rms_m},
                               {"inliers", affine->inliers},
                               {"points", affine->points}};
  }
  if (camera.time_offset_s) {
    tree["time_offset_s"] = *camera.time_offset_s;
    tree["time_offset_sigma_s"] = camera.time_offset_sigma_s;
  }
  if (const auto& held_out = camera.held_out) {
    tree["held_out"] = {{"views", held_out->views}, {"rms_px", held_out->rms_px}, {"rms_m", held_out->rms_m}};
  }
  return tree;
}

Json resultTree(const CalibrationResult& result) {
  Json tree = {{"schema_version", kResultSchemaVersion},
               {"provenance", result.provenance},
               {"goal_met", result.goal_met},
               {"missing", result.missing},
               {"board", boardTree(result.board)},
               {"observations", result.observations},
               {"motion_time_s", result.motion_time_s},
               {"tilt_time_s", result.tilt_time_s},
               {"cameras", Json::array()}};
  for (const CameraResult& camera : result.cameras) tree["cameras"].push_back(cameraTree(camera));
  for (const CameraPair& pair : result.camera_pairs)
    tree["camera_pairs"].push_back(pairTree(pair, cameraPairNames(pair.first, pair.second)));
  if (result.joint) tree["joint"] = jointTree(*result.joint);
  if (!result.joint_problem.empty()) tree["joint_problem"] = result.joint_problem;
  return tree;
}

}  // namespace

std::string resultJson(const CalibrationResult& result) {
  return resultTree(result).dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

void saveResult(const std::filesystem::path& file, const CalibrationResult& result) {
  std::string text;
  if (file.extension() == ".json") {
    text = resultJson(result);
  } else if (file.extension() == ".yaml" || file.extension() == ".yml") {
    text = "# servocal calibration; docs/result-schema.md explains every key.\n" + toYaml(resultTree(result));
  } else {
    throw std::invalid_argument("a result file ends in .yaml or .json, not '" + file.extension().string() +
                                "'");
  }
  const std::filesystem::path folder = std::filesystem::absolute(file).parent_path();
  makeFolder(folder);
  writeWhole(file, text.data(), text.size());
  syncFolder(folder);
}

}  // namespace servocal::session
