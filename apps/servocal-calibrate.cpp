// SPDX-License-Identifier: GPL-3.0-or-later
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <iostream>

#include "servocal/app/main.h"
#include "servocal/app/progress.h"
#include "servocal/app_cameras/cameras.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/error.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/procedure/summary.h"
#include "servocal/robot/guard.h"
#include "servocal/session/session.h"
#include "servocal/sim/cell.h"

namespace {

using namespace servocal;

robot::Guard* guard_of_signals = nullptr;
void stopOnSignal(int) { guard_of_signals->operatorStop(); }

void demandCamera(const CellConfig& cell, const std::string& name) {
  std::string names;
  for (const CameraConfig& camera : cell.cameras) {
    if (camera.name == name) return;
    names += (names.empty() ? "" : ", ") + camera.name;
  }
  throw Error(ErrorKind::kNothingToDo, "the cell has no camera '" + name + "'; it has: " + names);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Calibrates the cameras of a cell: the arm carries the board, a visual servo drives it to what "
               "no camera has seen yet. Moves the simulated arm; real arms are not supported yet.",
               "servocal-calibrate");
  std::string cell_file;
  std::filesystem::path out;
  std::uint64_t seed = 1;
  cli.add_option("CELL", cell_file, "Cell file (docs/cell-file.md); the built-in simulated cell if not given");
  cli.add_option("--out", out, "Folder for session and result; must not hold a session yet")->required();
  cli.add_option("--seed", seed, "Seed of the simulated cell")->capture_default_str();
  procedure::CalibrateOptions options;
  std::filesystem::path intrinsics_from;
  app::CameraOptions camera_options;
  cli.add_flag("--lock-exposure", camera_options.lock_exposure, "Keep exposure and white balance as they are after 2 s");
  cli.add_option("--camera", options.cameras, "Only these cameras, by name");
  cli.add_option("--intrinsics", intrinsics_from, "Result file whose intrinsics are believed instead of solved");
  cli.add_flag("--hand-eye-only", options.hand_eye_only, "Only where the cameras stand: no tilt limits, no coverage")
      ->needs("--intrinsics");
  cli.footer("Examples:\n"
             "  $ servocal-calibrate --out runs/first --seed 1\n"
             "  $ servocal-calibrate --out runs/moved --camera left --hand-eye-only --intrinsics "
             "runs/first/result.yaml\n");
  return app::guardedMain(cli, argc, argv, [&] {
    const CellConfig cell = cell_file.empty() ? defaultCell() : loadCell(cell_file);
    for (const std::string& name : options.cameras) demandCamera(cell, name);
    if (!intrinsics_from.empty()) options.given_intrinsics = procedure::intrinsicsOf(session::loadResult(intrinsics_from));
    sim::Cell simulation(cell, seed);
    const app::Cameras cameras(cell, simulation.clock(), &simulation, camera_options);
    for (const std::string& note : cameras.notes()) std::cerr << "Note: " << note << '\n';
    session::Session session = session::Session::create(out, cell.text, cell.board, seed);
    const robot::Kinematics kinematics(cell.arm);
    robot::Guard guard(simulation.arm(), kinematics, simulation.clock(), cell);
    guard_of_signals = &guard;
    struct sigaction action = {};
    action.sa_handler = stopOnSignal;
    action.sa_flags = SA_RESETHAND;  // a second Ctrl-C ends the program at once
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaction(signal, &action, nullptr);

    procedure::Devices devices{simulation.clock(), guard, cameras.all()};
    app::Progress progress;
    CalibrationResult result = procedure::calibrate(
        cell, devices, session, [&](const procedure::Event& event) { progress.show(procedure::line(event)); }, options);
    progress.finish();

    result.provenance = "servocal-calibrate, simulated cell '" + cell.name + "', seed " + std::to_string(seed);
    session::saveResult(out / "result.yaml", result);
    std::cout << procedure::summary(result) << "Wrote " << (out / "result.yaml").string() << " and the session in "
              << out.string() << '\n';
    return result.goal_met ? app::kOk : app::kGoalNotMet;
  });
}
