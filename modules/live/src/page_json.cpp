// SPDX-License-Identifier: GPL-3.0-or-later
#include "page_json.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "jpeg.h"

namespace servocal::live {
namespace {

using Json = nlohmann::json;

constexpr double kDegPerRad = 180.0 / M_PI;

double rounded(double value, int digits) {
  const double unit = std::pow(10.0, digits);
  return std::round(value * unit) / unit;
}

Json orNull(const std::optional<double>& value, double factor, int digits) {
  return value ? Json(rounded(*value * factor, digits)) : Json(nullptr);
}

Json flat(const std::vector<Eigen::Vector2d>& points) {
  Json list = Json::array();
  for (const Eigen::Vector2d& point : points) {
    list.push_back(rounded(point.x(), 1));
    list.push_back(rounded(point.y(), 1));
  }
  return list;
}

Json coverageTree(const CoverageSummary& coverage) {
  Json views = {{"near", coverage.near_views}, {"far", coverage.far_views}};
  for (const auto& [bin, count] : coverage.tilt_bins) views[bin] = count;
  return {{"cells_x", coverage.cells_x},
          {"cells_y", coverage.cells_y},
          {"corners", coverage.corners_per_cell},
          {"unreachable", coverage.unreachable},
          {"corners_to_fill", coverage.corners_to_fill},
          {"views", views}};
}

Json eyeTree(const procedure::EyeProgress& eye, const Snapshot& snapshot) {
  const EyeName name{eye.camera, eye.stream};
  Json tree = {{"camera", eye.camera},
               {"stream", toString(eye.stream)},
               {"views", eye.views},
               {"found", eye.found},
               {"sigma_mm", orNull(eye.sigma_m, 1e3, 3)},
               {"sigma_deg", orNull(eye.sigma_rad, kDegPerRad, 4)},
               {"rms_px", orNull(eye.rms_px, 1.0, 3)},
               {"coverage", coverageTree(eye.coverage)},
               {"tilt", Json::array()},
               {"sigma", {{"at_s", Json::array()}, {"mm", Json::array()}}},
               {"look", 0}};
  for (const TiltLimit& limit : eye.tilt_limits) {
    tree["tilt"].push_back({{"direction", limit.direction},
                            {"limit_deg", rounded(limit.limit_rad * kDegPerRad, 1)},
                            {"ended_by", limit.ended_by}});
  }
  if (const auto samples = snapshot.sigma.find(name); samples != snapshot.sigma.end()) {
    for (const SigmaSample& sample : samples->second) {
      tree["sigma"]["at_s"].push_back(rounded(sample.at_s, 1));
      tree["sigma"]["mm"].push_back(rounded(sample.sigma_m * 1e3, 4));
    }
  }
  if (const auto look = snapshot.looks.find(name); look != snapshot.looks.end())
    tree["look"] = look->second->number;
  return tree;
}

/// The newest look of all tells what the arm does.
const procedure::Look* newestLook(const Snapshot& snapshot) {
  const NumberedLook* newest = nullptr;
  for (const auto& [name, look] : snapshot.looks) {
    if (!newest || look->number > newest->number) newest = look.get();
  }
  return newest ? &newest->look : nullptr;
}

/// mm/s, then deg/s.
Json twistTree(const std::optional<Twist<Base>>& twist) {
  if (!twist) return nullptr;
  Json tree = Json::array();
  for (const double part : twist->linear_mps) tree.push_back(rounded(part * 1e3, 1));
  for (const double part : twist->angular_radps) tree.push_back(rounded(part * kDegPerRad, 2));
  return tree;
}

Json guardTree(const procedure::GuardLook& guard) {
  return {{"wanted", twistTree(guard.wanted)},
          {"applied", twistTree(guard.applied)},
          {"rule", guard.rule},
          {"reason", guard.reason},
          {"refused", guard.refused},
          {"interventions", guard.interventions},
          {"refused_at_s", guard.refused_at ? Json(rounded(toSeconds(*guard.refused_at), 1)) : Json(nullptr)},
          {"refused_reason", guard.refused_reason}};
}

Json armTree(const procedure::Look& look, const MotionLimits& limits) {
  const procedure::ArmLook& arm = look.arm;
  const double speed_mmps = arm.twist.linear_mps.norm() * 1e3,
               turn_degps = arm.twist.angular_radps.norm() * kDegPerRad;
  return {{"at_s", rounded(toSeconds(arm.stamp), 2)},
          {"twist", twistTree(arm.twist)},
          {"guard", guardTree(arm.guard)},
          {"speed_mmps", rounded(speed_mmps, 1)},
          {"max_speed_mmps", rounded(limits.max_speed_mps * 1e3, 1)},
          {"turn_degps", rounded(turn_degps, 2)},
          {"max_turn_degps", rounded(limits.max_angular_speed_radps * kDegPerRad, 2)},
          {"joint_room_deg", rounded(arm.joint_room_rad * kDegPerRad, 1)},
          {"joint_margin_deg", rounded(limits.joint_margin_rad * kDegPerRad, 1)},
          {"workspace_room_mm", rounded(arm.workspace_room_m * 1e3, 0)},
          {"frame_age_ms", rounded(toSeconds(arm.stamp - look.frame.stamp) * 1e3, 0)},
          {"max_frame_age_ms", rounded(toSeconds(arm.max_frame_age) * 1e3, 0)},
          {"stopped", arm.operator_stopped}};
}

Json servoTree(const std::deque<ServoSample>& samples) {
  Json tree = {{"at_s", Json::array()},
               {"error_px", Json::array()},
               {"speed_mmps", Json::array()},
               {"wanted_mmps", Json::array()},
               {"turn_degps", Json::array()}};
  for (const ServoSample& sample : samples) {
    tree["at_s"].push_back(rounded(sample.at_s, 2));
    tree["error_px"].push_back(orNull(sample.error_px, 1.0, 2));
    tree["speed_mmps"].push_back(rounded(sample.speed_mps * 1e3, 1));
    tree["wanted_mmps"].push_back(orNull(sample.wanted_mps, 1e3, 1));
    tree["turn_degps"].push_back(rounded(sample.turn_radps * kDegPerRad, 2));
  }
  return tree;
}

std::string text(const Json& tree) { return tree.dump(-1, ' ', false, Json::error_handler_t::replace); }

}  // namespace

std::string stateJson(const Snapshot& snapshot, const CellConfig& cell) {
  Json tree = {{"cell", cell.name},
               {"eyes", Json::array()},
               {"arm", nullptr},
               {"servo", servoTree(snapshot.servo)},
               {"messages", Json::array()},
               {"ending", nullptr}};
  if (snapshot.event) {
    const procedure::Event& event = *snapshot.event;
    tree["stage"] = event.stage;
    tree["turn"] = event.camera;
    tree["at_s"] = rounded(toSeconds(event.stamp), 1);
    tree["done"] = event.done;
    tree["planned"] = event.planned;
    tree["eta_s"] = orNull(event.eta_s, 1.0, 0);
    for (const procedure::EyeProgress& eye : event.eyes) tree["eyes"].push_back(eyeTree(eye, snapshot));
  } else {
    // Before the first event: whoever has looked already.
    for (const auto& [name, look] : snapshot.looks) {
      procedure::EyeProgress eye;
      eye.camera = name.first;
      eye.stream = name.second;
      tree["eyes"].push_back(eyeTree(eye, snapshot));
    }
  }
  if (const procedure::Look* look = newestLook(snapshot)) tree["arm"] = armTree(*look, cell.limits);
  for (const auto& [at_s, message] : snapshot.messages) {
    tree["messages"].push_back({{"at_s", rounded(at_s, 1)}, {"text", message}});
  }
  if (snapshot.ending)
    tree["ending"] = {{"goal_met", snapshot.ending->goal_met}, {"verdict", snapshot.ending->verdict}};
  return text(tree);
}

std::string lookJson(const NumberedLook& numbered) {
  const procedure::Look& look = numbered.look;
  return text({{"number", numbered.number},
               {"camera", look.camera},
               {"stream", toString(look.frame.stream)},
               {"width_px", look.frame.image.cols},
               {"height_px", look.frame.image.rows},
               {"corners", flat(look.corners)},
               {"goal", flat(look.goal)},
               {"expected", flat(look.expected)},
               {"error_px", orNull(look.error_px, 1.0, 2)},
               {"surprise_px", orNull(look.surprise_px, 1.0, 2)},
               {"image", jpegDataUrl(look.frame.image)}});
}

}  // namespace servocal::live
