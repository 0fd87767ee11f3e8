// SPDX-License-Identifier: GPL-3.0-or-later
#include "result_tree.h"

namespace servocal::session {
namespace {

Json projectionTree(const ProjectionMap& map) {
  return {{"cells_x", map.cells_x},
          {"cells_y", map.cells_y},
          {"sigma_px", map.sigma_px},
          {"worst_px", map.worst_px},
          {"rms_px", map.rms_px}};
}

Json workspaceTree(const WorkspaceMap& map) {
  return {{"cells_x", map.cells_x}, {"cells_y", map.cells_y}, {"cells_z", map.cells_z},
          {"sigma_m", map.sigma_m}, {"worst_m", map.worst_m}, {"rms_m", map.rms_m},
          {"seen", map.seen}};
}

Json cameraTree(const JointCameraResult& camera, Mount mount) {
  Json tree = {{"camera", camera.camera}, {"stream", toString(camera.stream)}};
  tree.update(cameraModelTree(camera.model, camera.sigma));
  tree["pose"] = poseTree(cameraPoseNames(mount, camera.camera, camera.stream), camera.pose,
                          camera.pose_covariance.diagonal().cwiseSqrt());
  tree["pose_covariance"] = matrix(camera.pose_covariance);
  tree["rms_px"] = camera.rms_px;
  tree["corner_scale"] = camera.corner_scale;
  tree["views"] = camera.views;
  tree["range_m"] = camera.range_m;
  tree["at_infinity"] = projectionTree(camera.at_infinity);
  tree["at_range"] = projectionTree(camera.at_range);
  tree["workspace"] = workspaceTree(camera.workspace);
  if (const auto& halves = camera.halves) tree["halves"] = {{"rms_px", halves->rms_px}, {"claimed_px", halves->claimed_px}};
  return tree;
}

Json pairTree(const JointPair& pair) {
  return {{"first", pair.first},
          {"first_stream", toString(pair.first_stream)},
          {"second", pair.second},
          {"second_stream", toString(pair.second_stream)},
          {"pose", poseTree(jointPairNames(pair), pair.first_by_second, pair.covariance.diagonal().cwiseSqrt())},
          {"covariance", matrix(pair.covariance)},
          {"worst_m", pair.worst_m},
          {"rms_m", pair.rms_m},
          {"seen", pair.seen}};
}

}  // namespace

Json jointTree(const JointResult& joint) {
  const Mount mount = joint.mount;
  Json tree = {{"mount", mount == Mount::kFixed ? "fixed" : "flange"},
               {"model", joint.model},
               {"cameras", Json::array()},
               {"pairs", Json::array()}};
  for (const JointCameraResult& camera : joint.cameras) tree["cameras"].push_back(cameraTree(camera, mount));
  for (const JointPair& pair : joint.pairs) tree["pairs"].push_back(pairTree(pair));
  tree["board"] = {{"pose", poseTree(boardPoseNames(mount), joint.board_pose, joint.board_sigma)},
                   {"scale_x", joint.board_scale_x},
                   {"scale_y", joint.board_scale_y},
                   {"bow_x_m", joint.board_bow_x_m},
                   {"bow_y_m", joint.board_bow_y_m}};
  Json terms = Json::array();
  for (const auto& [name, value] : joint.robot_terms) terms.push_back({{"name", name}, {"value", value}});
  tree["robot"] = {{"sigma_m", joint.robot_sigma_m},
                   {"sigma_deg", joint.robot_sigma_rad * kDegPerRad},
                   {"declared_sigma_m", joint.declared_sigma_m},
                   {"declared_sigma_deg", joint.declared_sigma_rad * kDegPerRad},
                   {"terms", terms}};
  tree["open"] = joint.open;
  tree["faults"] = joint.faults;
  tree["notes"] = joint.notes;
  if (const auto& held_out = joint.held_out) {
    tree["held_out"] = {{"views", held_out->views},
                        {"rms_px", held_out->rms_px},
                        {"rms_m", held_out->rms_m},
                        {"z", held_out->z}};
  }
  return tree;
}

}  // namespace servocal::session
