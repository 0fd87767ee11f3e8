// SPDX-License-Identifier: GPL-3.0-or-later
#include "joint_data.h"

#include <cmath>

namespace servocal::report {
namespace {

constexpr double kDegPerRad = 180.0 / M_PI;

/// The map as cells of a grid; numbers alone, the page knows the image's size.
Json mapTree(const ProjectionMap& map) {
  Json sigma = Json::array();
  for (const double value_px : map.sigma_px) sigma.push_back(rounded(value_px, 4));
  return {{"cells_x", map.cells_x},
          {"cells_y", map.cells_y},
          {"sigma_px", sigma},
          {"worst_px", rounded(map.worst_px, 3)},
          {"rms_px", rounded(map.rms_px, 3)}};
}

Json cameraTree(const JointCameraResult& camera) {
  const Eigen::Matrix<double, 6, 1> sigma = camera.pose_covariance.diagonal().cwiseSqrt();
  Json tree = {{"camera", camera.camera},
               {"stream", toString(camera.stream)},
               {"width_px", camera.model.width_px},
               {"height_px", camera.model.height_px},
               {"views", camera.views},
               {"rms_px", rounded(camera.rms_px, 4)},
               {"corner_scale", rounded(camera.corner_scale, 2)},
               {"place_sigma_mm", rounded(sigma.head<3>().norm() * 1e3, 3)},
               {"direction_sigma_deg", rounded(sigma.tail<3>().norm() * kDegPerRad, 4)},
               {"range_m", rounded(camera.range_m, 3)},
               {"at_range", mapTree(camera.at_range)},
               {"at_infinity", mapTree(camera.at_infinity)},
               {"workspace_worst_mm", rounded(camera.workspace.worst_m * 1e3, 3)},
               {"workspace_rms_mm", rounded(camera.workspace.rms_m * 1e3, 3)}};
  if (camera.halves) {
    tree["halves"] = {{"rms_px", rounded(camera.halves->rms_px, 3)},
                      {"claimed_px", rounded(camera.halves->claimed_px, 3)}};
  }
  return tree;
}

Json pairTree(const JointPair& pair) {
  const Eigen::Matrix<double, 6, 1> sigma = pair.covariance.diagonal().cwiseSqrt();
  return {{"first", pair.first + " " + toString(pair.first_stream)},
          {"second", pair.second + " " + toString(pair.second_stream)},
          {"apart_mm", rounded(pair.first_by_second.translation().norm() * 1e3, 1)},
          {"place_sigma_mm", rounded(sigma.head<3>().norm() * 1e3, 3)},
          {"direction_sigma_deg", rounded(sigma.tail<3>().norm() * kDegPerRad, 4)},
          {"worst_mm", rounded(pair.worst_m * 1e3, 3)},
          {"rms_mm", rounded(pair.rms_m * 1e3, 3)},
          {"seen", pair.seen}};
}

}  // namespace

Json jointData(const JointResult& joint, const std::optional<PlannerConfig>& goals) {
  Json tree = {{"model", joint.model},
               {"open", joint.open},
               {"faults", joint.faults},
               {"notes", joint.notes},
               {"cameras", Json::array()},
               {"pairs", Json::array()},
               {"board",
                {{"scale_x", rounded(joint.board_scale_x, 6)},
                 {"scale_y", rounded(joint.board_scale_y, 6)},
                 {"bow_x_mm", rounded(joint.board_bow_x_m * 1e3, 3)},
                 {"bow_y_mm", rounded(joint.board_bow_y_m * 1e3, 3)}}},
               {"robot",
                {{"sigma_mm", rounded(joint.robot_sigma_m * 1e3, 3)},
                 {"sigma_deg", rounded(joint.robot_sigma_rad * kDegPerRad, 4)},
                 {"declared_sigma_mm", rounded(joint.declared_sigma_m * 1e3, 3)},
                 {"declared_sigma_deg", rounded(joint.declared_sigma_rad * kDegPerRad, 4)},
                 {"terms", Json::array()}}}};
  for (const JointCameraResult& camera : joint.cameras) tree["cameras"].push_back(cameraTree(camera));
  for (const JointPair& pair : joint.pairs) tree["pairs"].push_back(pairTree(pair));
  for (const auto& [name, value] : joint.robot_terms)
    tree["robot"]["terms"].push_back({{"name", name}, {"value", rounded(value, 7)}});
  if (goals) {
    tree["goals"] = {{"worst_px", goals->projection_goal_px},
                     {"workspace_worst_mm", goals->point_goal_m * 1e3},
                     {"max_views", goals->max_views},
                     {"max_time_s", goals->max_time_s}};
  }
  if (joint.held_out) {
    tree["held_out"] = {{"views", joint.held_out->views},
                        {"rms_px", rounded(joint.held_out->rms_px, 3)},
                        {"rms_mm", rounded(joint.held_out->rms_m * 1e3, 3)},
                        {"z", rounded(joint.held_out->z, 2)}};
  }
  return tree;
}

}  // namespace servocal::report
