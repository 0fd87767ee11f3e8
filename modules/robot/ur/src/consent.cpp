// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/robot_ur/consent.h"

#include <cstdio>

namespace servocal::robot::ur {
namespace {

constexpr double kDegPerRad = 57.295779513082320876798154814105;

template <class... Values>
std::string line(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);
  return std::string(text) + '\n';
}

std::string boxLine(const char* what, const Box& box) {
  return std::string(what) + "\"" + box.name + "\"" +
         line(": x %.2f to %.2f, y %.2f to %.2f, z %.2f to %.2f m", box.min_m.x(), box.max_m.x(),
              box.min_m.y(), box.max_m.y(), box.min_m.z(), box.max_m.z());
}

}  // namespace

std::string consentText(const ControllerFacts& facts, const MotionLimits& limits) {
  std::string text = "A REAL ROBOT IS GOING TO MOVE BY ITSELF.\n\n";
  text += "  Address        " + facts.address + "\n";
  text += "  Model          " + facts.model + ", PolyScope " + facts.polyscope + "\n";
  text += "  Serial number  " + facts.serial + "\n";
  const Eigen::Vector3d tcp = facts.eMtcp.translation();
  text +=
      line("  Active TCP     %.1f, %.1f, %.1f mm on the flange", 1e3 * tcp.x(), 1e3 * tcp.y(), 1e3 * tcp.z());
  text += line("  Payload        %.3f kg", facts.payload_kg);
  text += line("  Speed at most  %.0f mm/s, %.0f deg/s; joints %.0f deg/s", 1e3 * limits.max_speed_mps,
               kDegPerRad * limits.max_angular_speed_radps, kDegPerRad * limits.max_joint_speed_radps);
  text += boxLine("  Stays inside   ", limits.workspace);
  for (const Box& box : limits.keep_out) text += boxLine("  Stays out of   ", box);
  if (limits.keep_out.empty()) text += "  Stays out of   nothing: the cell file names no keep-out box\n";
  text +=
      "\nBoxes are in the robot's base frame. This program is not a safety function: keep people out of "
      "reach, the\n"
      "robot's own safety limits set, and a hand at the emergency stop.\n"
      "Not run on a real Universal Robots arm: this driver is tested against a simulated controller only.\n"
      "\nType the serial number to let it move: ";
  return text;
}

}  // namespace servocal::robot::ur
