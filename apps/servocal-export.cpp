// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <sstream>

#include "servocal/app/main.h"
#include "servocal/core/error.h"
#include "servocal/report/export.h"
#include "servocal/session/session.h"

namespace {

using namespace servocal;

constexpr const char* kFooter = R"(
Every camera is written, color and infrared; which frame stands in which is printed. Exact, or refused
with the reason; where a format can only hold an approximation, what is left is printed (docs/exports.md).

tf allows a frame one parent. If a camera's driver publishes its optical frames itself, say where:
  --driver cam1=cam1_link,0.0,0.015,0.0,-0.5,0.5,-0.5,0.5
(frame of the driver; x y z in m and quaternion x y z w of cam1's color optical frame in it, as in
`ros2 run tf2_ros tf2_echo cam1_link cam1_color_optical_frame`). Then that frame is what is placed.

Moves no robot.

Example:
  $ servocal-export runs/first/result.yaml --format ros-camera-info --out ros
  cam1_color.yaml belongs to images stamped with frame cam1_color_optical_frame
  Wrote ros/cam1_color.yaml
)";

/// "cam1=cam1_link,x,y,z,qx,qy,qz,qw"
std::pair<std::string, report::DriverFrame> parseDriver(const std::string& text) {
  const auto refuse = [&] {
    throw Error(ErrorKind::kNothingToDo, "--driver '" + text + "': must be CAMERA=FRAME,x,y,z,qx,qy,qz,qw");
  };
  const std::size_t equals = text.find('='), comma = text.find(',');
  if (equals == std::string::npos || comma == std::string::npos || comma < equals) refuse();
  std::string list = text.substr(comma + 1);
  std::replace(list.begin(), list.end(), ',', ' ');
  std::istringstream in(list);
  Eigen::Vector3d t;
  Eigen::Vector4d q;
  in >> t.x() >> t.y() >> t.z() >> q.x() >> q.y() >> q.z() >> q.w();
  std::string rest;
  if (in.fail() || in >> rest || std::abs(q.norm() - 1.0) > 1e-3) refuse();
  const auto pose = Pose<Base, Color>::fromQuaternion(Eigen::Quaterniond(q), t);
  return {text.substr(0, equals), {text.substr(equals + 1, comma - equals - 1), pose.isometry()}};
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Writes a calibration as files that other programs load.", "servocal-export");
  cli.footer(kFooter);
  std::filesystem::path input, out;
  report::Format format{};
  report::ExportOptions options;
  std::vector<std::string> drivers;
  cli.add_option("RESULT", input, "result.yaml or .json, or the session folder that holds result.yaml")
      ->required();
  cli.add_option("--format", format, "Format")
      ->required()
      ->transform(CLI::CheckedTransformer(report::formats()));
  cli.add_option("--out", out, "Folder for the files; made if missing, files of the same name are replaced")
      ->required();
  cli.add_option("--base-frame", options.base_frame,
                 "The controller's base frame (on a UR `base`, not `base_link`)")
      ->capture_default_str();
  cli.add_option("--flange-frame", options.flange_frame, "The flange's frame")->capture_default_str();
  cli.add_option("--board-frame", options.board_frame, "The board's frame")->capture_default_str();
  cli.add_option("--driver", drivers,
                 "CAMERA=FRAME,x,y,z,qx,qy,qz,qw: what the camera's driver publishes; see below");
  return app::guardedMain(cli, argc, argv, [&] {
    const CalibrationResult result =
        session::loadResult(std::filesystem::is_directory(input) ? input / "result.yaml" : input);
    for (const std::string& driver : drivers) {
      const auto parsed = parseDriver(driver);
      const auto is_it = [&](const CameraResult& camera) { return camera.camera == parsed.first; };
      if (std::none_of(result.cameras.begin(), result.cameras.end(), is_it)) {
        throw Error(ErrorKind::kNothingToDo,
                    "--driver names '" + parsed.first + "', which the result does not have");
      }
      options.drivers.insert(parsed);
    }
    const report::Export exported = report::exportResult(result, format, options);
    if (exported.status == report::ExportStatus::kRefused) {
      throw Error(ErrorKind::kNothingToDo, exported.reason);
    }
    report::writeExport(exported, out);
    for (const std::string& note : exported.notes) std::cout << note << '\n';
    for (const report::ExportedFile& file : exported.files)
      std::cout << "Wrote " << (out / file.name).string() << '\n';
    return app::kOk;
  });
}
