// SPDX-License-Identifier: GPL-3.0-or-later
// Trees of frames: a ROS 2 launch file of static transforms, and URDF.
#include <algorithm>
#include <cmath>
#include <set>

#include "formats.h"
#include "number_text.h"
#include "rig.h"

namespace servocal::report {
namespace {

/// Roll, pitch, yaw about the fixed axes x, y, z of the parent: R = Rz(yaw) Ry(pitch) Rx(roll), as URDF has
/// it.
Eigen::Vector3d fixedAxisAngles(const Eigen::Matrix3d& r) {
  const double cosine = std::hypot(r(0, 0), r(1, 0));
  const double pitch = std::atan2(-r(2, 0), cosine);
  // Looking straight up or down roll and yaw turn about the same axis: all of it is called yaw.
  if (cosine < 1e-9) return {0.0, pitch, std::atan2(-r(0, 1), r(1, 1))};
  return {std::atan2(r(2, 1), r(2, 2)), pitch, std::atan2(r(1, 0), r(0, 0))};
}

std::string launchNode(const FrameEdge& edge) {
  const Eigen::Vector3d t = edge.parent_by_child.translation();
  const Eigen::Quaterniond q = Eigen::Quaterniond(edge.parent_by_child.linear()).normalized();
  const auto argument = [](const char* name, double value) {
    return std::string("            '") + name + "', '" + number(value) + "',\n";
  };
  return "        # " + edge.child + " in " + edge.parent + ": " + edge.about +
         ".\n        Node(package='tf2_ros', executable='static_transform_publisher', arguments=[\n" +
         argument("--x", t.x()) + argument("--y", t.y()) + argument("--z", t.z()) + argument("--qx", q.x()) +
         argument("--qy", q.y()) + argument("--qz", q.z()) + argument("--qw", q.w()) +
         "            '--frame-id', '" + edge.parent + "', '--child-frame-id', '" + edge.child + "']),\n";
}

std::string urdfJoint(const FrameEdge& edge) {
  return "  <!-- " + edge.about + " -->\n  <joint name=\"" + edge.child +
         "_joint\" type=\"fixed\">\n    <parent link=\"" + edge.parent + "\"/>\n    <child link=\"" +
         edge.child + "\"/>\n    <origin xyz=\"" + numbers(edge.parent_by_child.translation(), " ") +
         "\" rpy=\"" + numbers(fixedAxisAngles(edge.parent_by_child.linear()), " ") + "\"/>\n  </joint>\n";
}

/// The frames that nothing in the rig carries, in order of appearance.
std::vector<std::string> rootsOf(const Rig& rig) {
  std::vector<std::string> roots;
  for (const FrameEdge& edge : rig.edges) {
    const bool carried = std::any_of(rig.edges.begin(), rig.edges.end(),
                                     [&](const FrameEdge& other) { return other.child == edge.parent; });
    if (!carried && std::find(roots.begin(), roots.end(), edge.parent) == roots.end())
      roots.push_back(edge.parent);
  }
  return roots;
}

void noteFrames(Export& exported, const Rig& rig) {
  for (const FrameEdge& edge : rig.edges) {
    exported.notes.push_back(edge.child + " in " + edge.parent + ": " + edge.about);
  }
}

std::string unplaced(const Rig& rig) {
  return rig.edges.empty() ? "no camera stands anywhere: the result has neither hand-eye nor pairs of cameras"
                           : "";
}

}  // namespace

Export exportRos2StaticTf(const CalibrationResult& result, const ExportOptions& options) {
  const Rig rig = linkedRig(result, options);
  if (const std::string reason = unplaced(rig); !reason.empty()) return refused(reason);
  std::string text =
      "# Where the calibrated cameras stand, from servocal. ros2 launch ./static_transforms.launch.py\n"
      "# tf allows a frame one parent. If a camera's driver publishes its optical frames itself, do not use "
      "this\n"
      "# file for that camera as it is: export again with --driver, which places the driver's topmost "
      "frame.\n";
  for (const CameraResult& camera : result.cameras) {
    const auto pose = opticalRig(result, options).poseOf(camera.camera + "_color_optical_frame");
    if (!pose || pose->root == camera.camera + "_color_optical_frame") continue;
    const Eigen::Quaterniond q = Eigen::Quaterniond(pose->root_by_camera.linear()).normalized();
    text += "# For comparison, " + camera.camera + "_color_optical_frame in " + pose->root + ": xyz " +
            numbers(pose->root_by_camera.translation()) + "; xyzw " + numbers(q.coeffs()) + "\n";
  }
  text +=
      "from launch import LaunchDescription\nfrom launch_ros.actions import Node\n\n\n"
      "def generate_launch_description():\n    return LaunchDescription([\n";
  for (const FrameEdge& edge : rig.edges) text += launchNode(edge);
  text += "    ])\n";
  Export exported = complete();
  exported.files.push_back({"static_transforms.launch.py", text});
  noteFrames(exported, rig);
  return exported;
}

Export exportUrdf(const CalibrationResult& result, const ExportOptions& options) {
  const Rig rig = linkedRig(result, options);
  if (const std::string reason = unplaced(rig); !reason.empty()) return refused(reason);
  Export exported = complete();
  for (const std::string& root : rootsOf(rig)) {
    std::set<std::string> links = {root};
    std::string text =
        "<?xml version=\"1.0\"?>\n<!-- The calibrated cameras on " + root +
        ", from servocal. Origins in m; rpy about the parent's fixed axes x, y, z. -->\n<robot name=\"" +
        root + "_cameras\">\n  <link name=\"" + root + "\"/>\n";
    for (const FrameEdge& edge : rig.edges) {
      if (links.count(edge.parent) == 0) continue;
      links.insert(edge.child);
      text += "  <link name=\"" + edge.child + "\"/>\n" + urdfJoint(edge);
    }
    std::string file = root;  // frames may hold slashes
    std::replace(file.begin(), file.end(), '/', '_');
    exported.files.push_back({file + "_cameras.urdf", text + "</robot>\n"});
  }
  noteFrames(exported, rig);
  return exported;
}

}  // namespace servocal::report
