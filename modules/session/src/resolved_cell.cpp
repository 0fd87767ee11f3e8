// SPDX-License-Identifier: GPL-3.0-or-later
#include "resolved_cell.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <vector>

#include "servocal/core/error.h"

namespace servocal::session {
namespace {

using Json = nlohmann::ordered_json;

std::vector<double> list(const Eigen::VectorXd& values) {
  return {values.data(), values.data() + values.size()};
}

Json box(const Box& box) {
  return {{"name", box.name}, {"min_m", list(box.min_m)}, {"max_m", list(box.max_m)}};
}

Json arm(const ArmConfig& arm) {
  Json json = {{"backend", arm.backend == ArmBackend::kSim ? "sim" : "ur"},
               {"urdf", arm.urdf},
               {"base_link", arm.base_link},
               {"flange_link", arm.flange_link},
               {"start_q_rad", list(arm.start_q)},
               {"accuracy_m", arm.accuracy_m},
               {"accuracy_rad", arm.accuracy_rad}};
  if (arm.ur) json["ur"] = {{"host", arm.ur->host}, {"serial", arm.ur->serial}};
  if (arm.search) {
    json["search"] = {{"posture_q_rad", list(arm.search->posture_q)},
                      {"from_rad", arm.search->from_rad},
                      {"to_rad", arm.search->to_rad}};
  }
  return json;
}

Json limits(const MotionLimits& limits) {
  Json json = {{"max_speed_mps", limits.max_speed_mps},
               {"max_angular_speed_radps", limits.max_angular_speed_radps},
               {"max_acceleration_mps2", limits.max_acceleration_mps2},
               {"max_angular_acceleration_radps2", limits.max_angular_acceleration_radps2},
               {"max_joint_speed_radps", limits.max_joint_speed_radps},
               {"joint_margin_rad", limits.joint_margin_rad},
               {"workspace", box(limits.workspace)},
               {"keep_out", Json::array()}};
  for (const Box& keep_out : limits.keep_out) json["keep_out"].push_back(box(keep_out));
  return json;
}

Json camera(const CameraConfig& camera) {
  Json json = {{"name", camera.name},
               {"device", camera.device},
               {"mount", camera.mount == Mount::kFixed ? "fixed" : "flange"},
               {"width_px", camera.width_px},
               {"height_px", camera.height_px},
               {"horizontal_fov_rad", camera.horizontal_fov_rad},
               {"latency_s", camera.latency_s}};
  if (const auto& infrared = camera.infrared) {
    json["infrared"] = {{"width_px", infrared->width_px},
                        {"height_px", infrared->height_px},
                        {"horizontal_fov_rad", infrared->horizontal_fov_rad},
                        {"depth", infrared->depth ? Json(toString(*infrared->depth)) : Json()},
                        {"excludes_color", infrared->excludes_color}};
  }
  if (const auto& region = camera.region) {
    json["region_px"] = {region->x_px, region->y_px, region->width_px, region->height_px};
  }
  return json;
}

Json coverage(const CoverageConfig& coverage) {
  return {{"cells_x", coverage.cells_x},
          {"cells_y", coverage.cells_y},
          {"infrared_cells_x", coverage.infrared_cells_x},
          {"infrared_cells_y", coverage.infrared_cells_y},
          {"corners_per_cell", coverage.corners_per_cell},
          {"distance_ratio", coverage.distance_ratio},
          {"near_distance_m", coverage.near_distance_m},
          {"max_views", coverage.max_views},
          {"revisit_views", coverage.revisit_views},
          {"check_views", coverage.check_views}};
}

Json planner(const PlannerConfig& planner) {
  return {{"choose_by", planner.choose_by == Planner::kCoverage ? "coverage" : "information"},
          {"projection_goal_px", planner.projection_goal_px},
          {"point_goal_m", planner.point_goal_m},
          {"max_views", planner.max_views},
          {"max_time_s", planner.max_time_s}};
}

}  // namespace

std::string resolvedCell(const CellConfig& cell) {
  Json json = {{"name", cell.name},        {"file", cell.file.string()},
               {"arm", arm(cell.arm)},     {"limits", limits(cell.limits)},
               {"cameras", Json::array()}, {"coverage", coverage(cell.coverage)},
               {"planner", planner(cell.planner)}};
  for (const CameraConfig& one : cell.cameras) json["cameras"].push_back(camera(one));
  return json.dump(1, ' ', false, Json::error_handler_t::replace);
}

std::optional<std::string> urdfText(const CellConfig& cell) {
  if (cell.arm.urdf == "ur5") return std::nullopt;
  std::ifstream in(cell.arm.urdf, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw Error(ErrorKind::kBadData, "URDF file '" + cell.arm.urdf + "' cannot be read");
  return text.str();
}

}  // namespace servocal::session
