// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdio>

#include "servocal/app_dry_run/dry_run.h"

namespace servocal::app {
namespace {

constexpr double kDegPerRad = 57.295779513082320876798154814105;

template <class... Values>
std::string line(const char* format, Values... values) {
  char text[400];
  std::snprintf(text, sizeof text, format, values...);
  return std::string(text) + '\n';
}

std::string boxLine(const char* what, const Box& box) {
  return std::string(what) + (box.name.empty() ? "" : "'" + box.name + "' ") +
         line("x %.2f to %.2f, y %.2f to %.2f, z %.2f to %.2f m", box.min_m.x(), box.max_m.x(), box.min_m.y(),
              box.max_m.y(), box.min_m.z(), box.max_m.z());
}

std::string stopLine(const PlannedStop& stop) {
  const Eigen::Vector3d at = stop.bMe.translation();
  std::string text = line("  %6.0f s  flange at %6.3f %6.3f %6.3f  ", stop.at_s, at.x(), at.y(), at.z());
  text.pop_back();
  if (!stop.objection.empty()) return text + stop.what + ". NOT DONE: " + stop.objection + '\n';
  char room[200] = "over 100 mm free";
  if (!stop.nearest.empty())
    std::snprintf(room, sizeof room, "%.0f mm between %s", 1e3 * stop.clearance_m, stop.nearest.c_str());
  return text + stop.what + "; " + room + '\n';
}

}  // namespace

std::string text(const CellConfig& cell, const DryRun& plan) {
  std::string text = "Dry run of cell '" + cell.name + "': no device is opened, nothing moves.\n";
  const MotionLimits& limits = cell.limits;
  text += line("Speed at most %.0f mm/s, %.0f deg/s; joints %.0f deg/s.", 1e3 * limits.max_speed_mps,
               kDegPerRad * limits.max_angular_speed_radps, kDegPerRad * limits.max_joint_speed_radps);
  text += boxLine("Stays inside ", limits.workspace);
  for (const Box& box : limits.keep_out) text += boxLine("Stays out of ", box);
  text +=
      "Distances are to what the guard knows: the arm's links by its URDF, the board once its place on the\n"
      "flange is known, keep-out boxes, and a ball around every camera that is known.\n\n";
  if (cell.planner.choose_by == Planner::kInformation) {
    text +=
        "The cell's planner goes by information: its views follow from what the run has seen. Those below are what\n"
        "covering every image would take, more than it will.\n\n";
  }
  for (const PlannedStop& stop : plan.start) text += stopLine(stop);
  for (const PlannedCamera& camera : plan.cameras) {
    text += "\nCamera '" + camera.camera + "'";
    if (!camera.unknown.empty()) {
      text += ": no views planned, " + camera.unknown + ".\n";
      continue;
    }
    text += line(": %zu stops; fill %d of %d image cells, %d out of reach.", camera.stops.size(),
                 camera.cells_filled, camera.cells, camera.cells_out_of_reach);
    for (const PlannedStop& stop : camera.stops) text += stopLine(stop);
  }
  text += line("\nAbout %.0f s of motion and stops for what is planned here.", plan.duration_s);
  return text;
}

}  // namespace servocal::app
