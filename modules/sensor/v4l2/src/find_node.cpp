// SPDX-License-Identifier: GPL-3.0-or-later
#include "find_node.h"

#include <unistd.h>

#include <algorithm>
#include <vector>

#include "servocal/core/error.h"

namespace servocal::v4l2 {
namespace {

namespace fs = std::filesystem;

// A camera has several nodes; the first delivers images, the others tell about them.
constexpr char kImages[] = "-video-index0";

[[noreturn]] void absent(const CameraConfig& config, const std::string& what) {
  throw Error(ErrorKind::kHardwareAbsent, "Camera '" + config.name + "': " + what);
}

std::vector<Node> namedNodes(const fs::path& devices) {
  std::vector<Node> nodes;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(devices / "v4l" / "by-id", none)) {
    const std::string file = entry.path().filename().string();
    const auto at = file.rfind(kImages);
    if (at != std::string::npos && at + sizeof kImages - 1 == file.size())
      nodes.push_back({entry.path(), file.substr(0, at)});
  }
  std::sort(nodes.begin(), nodes.end(), [](const Node& a, const Node& b) { return a.name < b.name; });
  return nodes;
}

std::string list(const std::vector<Node>& nodes) {
  std::string text;
  for (const Node& node : nodes) text += (text.empty() ? "" : ", ") + node.name;
  return text.empty() ? "none" : text;
}

/// Under its name, if the kernel gave it one: that stays when the number changes.
Node named(const fs::path& path, const std::vector<Node>& nodes) {
  std::error_code none;
  const fs::path target = fs::canonical(path, none);
  for (const Node& node : nodes) {
    if (!target.empty() && fs::canonical(node.path, none) == target) return node;
  }
  return {path, ""};
}

Node search(const CameraConfig& config, const fs::path& devices) {
  const std::string& device = config.device;
  const std::vector<Node> nodes = namedNodes(devices);
  if (!device.empty() && device.find_first_not_of("0123456789") == std::string::npos)
    return named(devices / ("video" + device), nodes);
  if (!device.empty() && device.front() == '/') return named(device, nodes);
  std::vector<Node> fitting;
  for (const Node& node : nodes) {
    if (node.name.find(device) != std::string::npos) fitting.push_back(node);
  }
  if (fitting.size() == 1) return fitting.front();
  if (fitting.empty()) {
    absent(config,
           device.empty()
               ? "there is no video device with a name (in /dev/v4l/by-id). Plug the camera in, or name "
                 "its number or path ('device' in the cell file)."
               : "no video device has '" + device + "' in its name; there are: " + list(nodes) + ".");
  }
  absent(config, "several video devices fit: " + list(fitting) + ". Name one ('device' in the cell file).");
}

}  // namespace

Node findNode(const CameraConfig& config, const fs::path& devices) {
  const Node node = search(config, devices);
  std::error_code none;
  if (!fs::exists(node.path, none))
    absent(config, "there is no " + node.path.string() + ". Is it plugged in?");
  if (::access(node.path.c_str(), R_OK | W_OK) != 0) {
    absent(config,
           "this user may not open " + node.path.string() +
               ". Add the user to its group (usually: sudo usermod -aG video $USER), then log in anew.");
  }
  return node;
}

}  // namespace servocal::v4l2
