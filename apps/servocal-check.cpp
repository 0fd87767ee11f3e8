// SPDX-License-Identifier: GPL-3.0-or-later
#include <filesystem>
#include <iostream>

#include "servocal/app/main.h"
#include "servocal/app/progress.h"
#include "servocal/app/stop_on_signal.h"
#include "servocal/app_arm/cell_arm.h"
#include "servocal/app_arm/start_pose.h"
#include "servocal/app_cameras/cameras.h"
#include "servocal/core/cell_config.h"
#include "servocal/procedure/check.h"
#include "servocal/procedure/summary.h"
#include "servocal/robot/guard.h"
#include "servocal/session/session.h"

namespace {

using namespace servocal;
namespace fs = std::filesystem;

constexpr const char* kFooter = R"(
The test: every deviation is measured against the result's standard deviations and the robot's accuracy;
when nothing has changed, 1 check in 100 says that something has. What it finds: docs/results.md.

With --repair the poses of what moved are replaced in the result file; the file as it was is kept beside it,
with the ending .before-repair. Changed intrinsics need a calibration.

Example:
  $ servocal-check cell.yaml --result runs/first/result.yaml
  cam1: 8 views, predicted to 3.31 px RMS
  Camera 'cam1' moved by 1.9 mm (x +0.8, y +1.4, z -0.9) and 0.01 degrees, along the axes of the robot's base.
  Fix it, then repair where it stands, or calibrate it again.
  The arm moved for 26.1 s. Views are in runs/first/check-1
)";

/// check-1, check-2, ... beside the result.
fs::path freeFolder(const fs::path& result) {
  for (int number = 1;; ++number) {
    const fs::path folder = result.parent_path() / ("check-" + std::to_string(number));
    if (!fs::exists(folder)) return folder;
  }
}

void print(const procedure::CheckVerdict& verdict) {
  for (const procedure::CameraCheck& camera : verdict.cameras) {
    std::cout << camera.camera << ": " << camera.views << " views, predicted to " << camera.rms_px
              << " px RMS\n";
  }
  std::cout << verdict.sentence << '\n';
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli(
      "Asks whether a calibration still holds: the arm carries the board to a few views, in less than a\n"
      "minute. Says OK, or what moved, by how much and which way. Moves the arm: the simulated one at once,\n"
      "a real one only with --arm and after its serial number was typed.",
      "servocal-check");
  cli.footer(kFooter);
  std::string cell_file;
  fs::path result_file, out;
  std::uint64_t seed = 1;
  bool repair = false;
  app::ArmOptions arm_options;
  app::CameraOptions camera_options;
  cli.add_option("CELL", cell_file, "Cell file; the built-in simulated cell if not given");
  cli.add_option("--result", result_file, "Result file of the calibration")->required();
  cli.add_option("--out", out,
                 "Folder for the views taken; check-1, check-2, ... beside the result if not given");
  cli.add_option("--seed", seed, "Seed of the simulated cell")->capture_default_str();
  cli.add_flag("--arm", arm_options.arm,
               "Let a real arm move; asks for its serial number at the terminal first");
  cli.add_flag("--lock-exposure", camera_options.lock_exposure,
               "Keep exposure and white balance as they are after 2 s");
  cli.add_flag("--repair", repair, "Put right in the result file what moved, and only that");
  return app::guardedMain(cli, argc, argv, [&] {
    const CellConfig cell = cell_file.empty() ? defaultCell() : loadCell(cell_file);
    arm_options.seed = seed;
    app::CellArm arm(cell, arm_options);
    const CalibrationResult stored = session::loadResult(result_file);
    if (out.empty()) out = freeFolder(result_file);
    const app::Cameras cameras(cell, arm.clock(), arm.simulation(), camera_options);
    for (const std::string& note : arm.notes()) std::cerr << "Note: " << note << '\n';
    for (const std::string& note : cameras.notes()) std::cerr << "Note: " << note << '\n';
    const robot::Kinematics kinematics(cell.arm);
    robot::Guard guard(arm.device(), kinematics, arm.clock(), cell);
    arm.askConsent();
    const app::StopOnSignal stop([&] { guard.operatorStop(); });
    session::Session session = session::Session::create(out, cell, seed);
    const procedure::Devices devices{arm.clock(), guard, cameras.all()};
    app::Progress progress;
    app::goToStart(cell, guard, arm.clock());
    const procedure::CheckVerdict verdict =
        procedure::check(cell, devices, stored, session,
                         [&](const procedure::Event& event) { progress.show(procedure::line(event)); });
    progress.finish();
    print(verdict);
    if (const auto span = guard.motionSpan()) {
      std::cout << "The arm moved for " << toSeconds(span->second - span->first) << " s. Views are in "
                << out.string() << '\n';
    }
    if (verdict.status == procedure::CheckStatus::kOk) return app::kOk;
    if (!repair || verdict.status != procedure::CheckStatus::kChanged) return app::kGoalNotMet;
    const procedure::Repaired repaired = procedure::repaired(stored, verdict);
    fs::copy_file(result_file, result_file.string() + ".before-repair", fs::copy_options::overwrite_existing);
    session::saveResult(result_file, repaired.result);
    std::cout << "Wrote " << result_file.string() << '\n';
    return repaired.whole ? app::kOk : app::kGoalNotMet;
  });
}
