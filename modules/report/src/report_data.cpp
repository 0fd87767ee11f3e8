// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <map>

#include "arm_skeleton.h"
#include "camera_data.h"
#include "evidence.h"
#include "joint_data.h"
#include "json.h"
#include "next_steps.h"
#include "number_text.h"
#include "servocal/core/best_estimate.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/error.h"
#include "servocal/report/report.h"
#include "servocal/session/session.h"
#include "timeline.h"

namespace servocal::report {
namespace {

/// The numbers that decide, for the top of the page, with the limit below which each is good. The page sets
/// what has the same name side by side.
Json headline(const CalibrationResult& result) {
  Json rows = Json::array();
  std::string of;
  const auto add = [&](const std::string& what, double value, int digits, const char* unit, double limit) {
    rows.push_back({{"of", of},
                    {"what", what},
                    {"value", rounded(value, digits)},
                    {"unit", unit},
                    {"good", "below " + shortNumber(limit) + " " + unit},
                    {"within", value < limit}});
  };
  for (const CameraResult& camera : result.cameras) {
    of = camera.camera;
    if (camera.held_out) {
      add("error in views no solver saw, the robot's in it", camera.held_out->rms_m * 1e3, 2, "mm", 1.0);
      add("the same in the image", camera.held_out->rms_px, 2, "px", 2.0);
    }
    if (camera.hand_eye) {
      const auto& sigma = camera.hand_eye->camera_sigma;
      add("place known to, 1 sigma", sigma.head<3>().norm() * 1e3, 2, "mm", 1.0);
      add("direction known to, 1 sigma", sigma.tail<3>().norm() * 180 / M_PI, 3, "deg", 0.1);
      add("hand-eye residual (fit, not accuracy)", camera.hand_eye->rms_px, 3, "px", 0.5);
    }
    const auto addLens = [&](const std::string& stream, const IntrinsicsResult& intrinsics) {
      if (intrinsics.sigma.size() == 0) return;
      double worst_px = 0.0;
      for (const PixelSigma& at : projectionSigma(intrinsics, 17, 11))
        worst_px = std::max(worst_px, at.sigma_px);
      if (worst_px > 0) add(stream + ": worst pixel known to, 1 sigma", worst_px, 2, "px", 0.5);
      add(stream + ": lens residual (fit, not accuracy)", intrinsics.rms_px, 3, "px", 0.3);
    };
    addLens("color", camera.intrinsics);
    if (camera.infrared) addLens("infrared", *camera.infrared);
    if (camera.depth)
      add("depth error left (fit, not accuracy)", camera.depth->rms_after_m * 1e3, 2, "mm", 5.0);
  }
  return rows;
}

Json boardOutline(const BoardSpec& board) {
  Json outline = Json::array();
  for (const Eigen::Vector3d& corner : board.outline()) outline.push_back(rounded(corner, 4));
  return outline;
}

/// Corners of the image on a plane `depth_m` in front of the camera.
Json frustum(const CameraModel& camera, double depth_m) {
  Json corners = Json::array();
  for (const auto& [x, y] : {std::pair(0, 0), std::pair(1, 0), std::pair(1, 1), std::pair(0, 1)}) {
    const Eigen::Vector2d plain((x * (camera.width_px - 1) - camera.cx()) / camera.fx(),
                                (y * (camera.height_px - 1) - camera.cy()) / camera.fy());
    corners.push_back(rounded(Eigen::VectorXd(depth_m * Eigen::Vector3d(plain.homogeneous())), 4));
  }
  return corners;
}

Json sceneTree(const ReportInput& input) {
  Json scene = {{"cameras", Json::array()},
                {"moving", Json::array()},
                {"arms", Json::array()},
                {"board_outline_m", boardOutline(input.result.board)}};
  bool boards_drawn = false;
  for (const CameraResult& camera : input.result.cameras) {
    if (!camera.hand_eye || !camera.hand_eye->camera_pose.matrix().allFinite()) continue;
    const HandEyeSolution& hand_eye = *camera.hand_eye;
    const bool fixed = hand_eye.mount == Mount::kFixed;
    const auto matrix = [](const Eigen::Isometry3d& pose) {
      return rounded(Eigen::VectorXd(pose.matrix().reshaped()), 6);  // column by column, as three.js has it
    };
    const std::vector<VisitedPose> visited = visitedPoses(input, camera);
    if (fixed) {
      scene["cameras"].push_back({{"name", camera.camera + " color"},
                                  {"pose", matrix(hand_eye.camera_pose)},
                                  {"frustum_m", frustum(camera.intrinsics.camera, 0.12)},
                                  {"sigma_m", rounded(Eigen::VectorXd(hand_eye.camera_sigma.head<3>()), 7)}});
      if (camera.infrared && camera.color_infrared) {
        scene["cameras"].push_back(
            {{"name", camera.camera + " infrared"},
             {"pose", matrix(hand_eye.camera_pose * camera.color_infrared->first_by_second)},
             {"frustum_m", frustum(camera.infrared->camera, 0.09)}});
      }
    } else {
      scene["board"] = matrix(hand_eye.board_pose);
    }
    if (fixed && boards_drawn) continue;  // all fixed cameras see the same board on the same flange
    boards_drawn = boards_drawn || fixed;
    for (const VisitedPose& pose : visited) {
      scene["moving"].push_back({{"kind", fixed ? "board" : "camera"},
                                 {"stage", pose.stage},
                                 {"pose", matrix(pose.base_by_moving)}});
    }
  }
  constexpr int kArms = 6;
  for (const ArmLine& line : armLines(input, kArms)) {
    Json points = Json::array();
    for (const Eigen::Vector3d& point : line) points.push_back(rounded(point, 4));
    scene["arms"].push_back(points);
  }
  return scene;
}

Json pairsTree(const std::vector<CameraPair>& pairs) {
  Json rows = Json::array();
  for (const CameraPair& pair : pairs) rows.push_back(pairData(pair, pair.first, pair.second));
  return rows;
}

Json provenanceTree(const ReportInput& input) {
  std::string devices, options;
  for (const LogLine& line : input.log) {
    if (line.kind == "device") devices += (devices.empty() ? "" : "; ") + line.message;
    if (line.kind == "options") options = line.message;
  }
  Json tree = {{"report_by", std::string("servocal ") + SERVOCAL_VERSION}, {"source", input.source}};
  const auto addKnown = [&](const char* key, const std::string& text) {
    if (!text.empty()) tree[key] = text;
  };
  addKnown("session_by", input.programs);
  addKnown("result", input.result.provenance);
  addKnown("devices", devices);
  addKnown("calibrated", options);
  tree["board"] = input.result.board.describe();
  tree["observations"] = input.result.observations;
  tree["motion_time_s"] = rounded(input.result.motion_time_s, 1);
  tree["tilt_time_s"] = rounded(input.result.tilt_time_s, 1);
  tree["cell_file"] = input.cell_text;
  return tree;
}

/// What the cell file wants of a run whose views follow from information; nothing of others.
std::optional<PlannerConfig> goalsOf(const ReportInput& input) {
  if (input.cell_text.empty()) return std::nullopt;
  const PlannerConfig planner = parseCell(input.cell_text, "cell file").planner;
  if (planner.choose_by != Planner::kInformation) return std::nullopt;
  return planner;
}

}  // namespace

ReportInput loadReportInput(const std::filesystem::path& session_or_result) {
  ReportInput input;
  input.source = session_or_result.string();
  std::filesystem::path folder = session_or_result, result = session_or_result;
  if (std::filesystem::is_directory(session_or_result)) {
    result = folder / "result.yaml";
    if (session::isSession(folder) && !std::filesystem::exists(result)) {
      throw Error(ErrorKind::kNothingToDo, "session '" + folder.string() +
                                               "' has no result.yaml yet; solve it first: "
                                               "servocal-solve " +
                                               folder.string() + " --out " + result.string());
    }
  } else {
    folder = session_or_result.parent_path().empty() ? "." : session_or_result.parent_path();
  }
  input.result = session::loadResult(result);
  if (!session::isSession(folder)) return input;
  const session::Session recorded = session::Session::open(folder);
  input.folder = folder;
  input.observations = recorded.observations();
  input.attempts = recorded.attempts();
  for (session::SessionEvent& event : recorded.events())
    input.log.push_back({event.stamp, std::move(event.kind), std::move(event.message)});
  input.programs = recorded.programs();
  input.cell_text = recorded.cellText();
  const CellConfig cell = parseCell(input.cell_text, "cell file of session " + folder.string());
  input.robot_accuracy_m = cell.arm.accuracy_m;
  input.robot_accuracy_rad = cell.arm.accuracy_rad;
  return input;
}

std::string reportJson(const ReportInput& input) {
  const CalibrationResult& result = input.result;
  Json tree = {{"report_version", 2},
               {"verdict",
                {{"goal_met", result.goal_met}, {"missing", result.missing}, {"numbers", headline(result)}}},
               {"next_steps", nextSteps(result)},
               {"cameras", Json::array()},
               {"pairs", pairsTree(result.camera_pairs)},
               {"scene", sceneTree(input)},
               {"timeline", timelineData(input)},
               {"provenance", provenanceTree(input)}};
  if (result.joint) tree["joint"] = jointData(*result.joint, goalsOf(input));
  tree["joint_problem"] = result.joint_problem;
  const CalibrationResult best = bestEstimate(result);
  for (std::size_t i = 0; i < result.cameras.size(); ++i)
    tree["cameras"].push_back(cameraData(input, result.cameras[i], best.cameras[i]));
  return tree.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace servocal::report
