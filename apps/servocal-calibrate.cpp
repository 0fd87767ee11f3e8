// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <filesystem>
#include <iostream>
#include <optional>

#include "servocal/app/main.h"
#include "servocal/app/progress.h"
#include "servocal/app/stop_on_signal.h"
#include "servocal/app_arm/cell_arm.h"
#include "servocal/app_arm/start_pose.h"
#include "servocal/app_cameras/cameras.h"
#include "servocal/app_dry_run/dry_run.h"
#include "servocal/core/cell_config.h"
#include "servocal/core/error.h"
#include "servocal/live/server.h"
#include "servocal/procedure/calibrate.h"
#include "servocal/procedure/recorded.h"
#include "servocal/procedure/summary.h"
#include "servocal/robot/guard.h"
#include "servocal/session/session.h"

namespace {

using namespace servocal;

void demandCamera(const CellConfig& cell, const std::string& name) {
  std::string names;
  for (const CameraConfig& camera : cell.cameras) {
    if (camera.name == name) return;
    names += (names.empty() ? "" : ", ") + camera.name;
  }
  throw Error(ErrorKind::kNothingToDo, "the cell has no camera '" + name + "'; it has: " + names);
}

/// The cell of a session, which the cell file must still describe.
CellConfig cellOf(const session::Session& session, const std::string& cell_file) {
  const std::string name = "session '" + session.folder().string() + "'";
  if (cell_file.empty()) return parseCell(session.cellText(), "cell file in " + name);
  CellConfig cell = loadCell(cell_file);
  if (cell.text == session.cellText()) return cell;
  throw Error(ErrorKind::kInvalidConfig,
              "'" + cell_file + "' is not the cell file that " + name +
                  " was begun with; resume without a cell file, or begin a new session");
}

/// An earlier result: a file, or a session's folder; solved from what was observed if that run did not end.
CalibrationResult earlierResult(const std::filesystem::path& from) {
  if (!std::filesystem::is_directory(from)) return session::loadResult(from);
  if (std::filesystem::exists(from / "result.yaml")) return session::loadResult(from / "result.yaml");
  return procedure::solveRecorded(session::Session::open(from));
}

int dryRun(const CellConfig& cell, const std::filesystem::path& known_from) {
  std::optional<CalibrationResult> known;
  if (!known_from.empty()) known = earlierResult(known_from);
  const app::DryRun plan = app::dryRun(cell, known);
  std::cout << app::text(cell, plan);
  return plan.start.front().objection.empty() ? app::kOk : app::kGoalNotMet;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli(
      "Calibrates the cameras of a cell: the arm carries the board, a visual servo drives it to what "
      "no camera has seen yet. Moves the arm: the simulated one at once, a real one only with --arm and\n"
      "after its serial number was typed.",
      "servocal-calibrate");
  std::string cell_file;
  std::filesystem::path out, resume;
  std::uint64_t seed = 1;
  cli.add_option("CELL", cell_file,
                 "Cell file (docs/cell-file.md); the built-in simulated cell if not given");
  CLI::App* const where = cli.add_option_group("Session", "Where it is kept");
  where->require_option(1);  // One of the three.
  where->add_option("--out", out, "Folder for session and result; must not hold a session yet");
  CLI::Option* const resumes = where->add_option(
      "--resume", resume,
      "Folder of a session that was interrupted: goes on where it stopped, with the same options");
  bool dry_run = false;
  std::filesystem::path known_from;
  CLI::Option* const dry = where->add_flag(
      "--dry-run", dry_run, "Move nothing, open nothing: print the planned views, times and clearances");
  cli.add_option("--result", known_from,
                 "Of --dry-run: an earlier result file or session, which tells where the cameras stand")
      ->needs(dry);
  cli.add_option("--seed", seed, "Seed of the simulated cell")->capture_default_str()->excludes(resumes);
  app::ArmOptions arm_options;
  cli.add_flag("--arm", arm_options.arm,
               "Let a real arm move; asks for its serial number at the terminal first");
  procedure::CalibrateOptions options;
  std::filesystem::path intrinsics_from, earlier_from;
  app::CameraOptions camera_options;
  cli.add_flag("--lock-exposure", camera_options.lock_exposure,
               "Keep exposure and white balance as they are after 2 s");
  cli.add_option("--camera", options.cameras, "Only these cameras, by name");
  cli.add_option("--intrinsics", intrinsics_from,
                 "Result file whose intrinsics are believed instead of solved");
  cli.add_option(
      "--known", earlier_from,
      "Result file or session of an earlier run of this cell: its board mount and tilt limits are\n"
      "believed instead of sought");
  cli.add_flag("--hand-eye-only", options.hand_eye_only,
               "Only where the color cameras stand: no tilt limits, no coverage, no infrared, no depth")
      ->needs("--intrinsics");
  live::ServerOptions live_options;
  bool watched = false, json = false;
  cli.add_flag("--live", watched, "Serve a page to watch the run, with a button that stops the arm");
  cli.add_option("--live-port", live_options.port, "Where the page is served; 0: any free port")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str()
      ->needs("--live");
  cli.add_option("--live-host", live_options.host,
                 "And at which address of this machine, 0.0.0.0 for all of them")
      ->capture_default_str()
      ->needs("--live");
  cli.add_flag("--json", json, "Print the result as JSON on stdout, the summary on stderr");
  cli.footer(
      "Examples:\n"
      "  $ servocal-calibrate --out runs/first --seed 1 --live\n"
      "  $ servocal-calibrate --out runs/moved --camera left --hand-eye-only --intrinsics "
      "runs/first/result.yaml\n"
      "  $ servocal-calibrate --out runs/again --known runs/first\n"
      "  $ servocal-calibrate --resume runs/first\n"
      "  $ servocal-calibrate ur5.yaml --dry-run --result runs/first\n"
      "  $ servocal-calibrate ur5.yaml --out runs/real --arm\n\n"
      "Ctrl-C, a closed terminal or a termination signal stop the arm and keep what was observed; a second\n"
      "Ctrl-C ends the program at once.\n");
  return app::guardedMain(cli, argc, argv, [&] {
    std::optional<session::Session> resumed;
    if (!resume.empty()) resumed.emplace(session::Session::openForAppend(out = resume));
    const CellConfig cell = resumed             ? cellOf(*resumed, cell_file)
                            : cell_file.empty() ? defaultCell()
                                                : loadCell(cell_file);
    if (dry_run) return dryRun(cell, known_from);
    if (resumed) seed = resumed->seed();
    for (const std::string& name : options.cameras) demandCamera(cell, name);
    if (!intrinsics_from.empty())
      options.given_intrinsics = procedure::intrinsicsOf(session::loadResult(intrinsics_from));
    if (!earlier_from.empty()) options.known = earlierResult(earlier_from);
    arm_options.seed = seed;
    app::CellArm arm(cell, arm_options);
    const app::Cameras cameras(cell, arm.clock(), arm.simulation(), camera_options);
    for (const std::string& note : arm.notes()) std::cerr << "Note: " << note << '\n';
    for (const std::string& note : cameras.notes()) std::cerr << "Note: " << note << '\n';
    const robot::Kinematics kinematics(cell.arm);
    robot::Guard guard(arm.device(), kinematics, arm.clock(), cell);
    arm.askConsent();
    const app::StopOnSignal stop([&] { guard.operatorStop(); });
    procedure::Devices devices{arm.clock(), guard, cameras.all()};
    std::optional<live::Server> page;
    procedure::LookSink on_look;
    if (watched) {
      page.emplace(
          cell, [&guard] { guard.operatorStop(); }, live_options);
      on_look = [&page](const procedure::Look& look) { page->show(look); };
      std::cerr << "Live page: " << page->url() << std::endl;
    }
    options.arm = arm.device().info().model + " " + arm.device().info().serial;
    session::Session session = resumed ? *std::move(resumed) : session::Session::create(out, cell, seed);
    app::Progress progress;
    const auto on_event = [&](const procedure::Event& event) {
      progress.show(procedure::line(event));
      if (page) page->show(event);
    };
    const auto keepRecord = [&] {
      for (const std::string& entry : arm.record()) session.event(arm.clock().now(), "arm", entry);
    };
    CalibrationResult result;
    try {
      app::goToStart(cell, guard, arm.clock());
      result = procedure::calibrate(cell, devices, session, on_event, options, on_look);
    } catch (const std::exception& error) {
      progress.finish();
      if (page) page->finish(false, error.what());
      try {
        keepRecord();
      } catch (const Error&) {  // What ended the run is what must be told.
      }
      throw;
    }
    progress.finish();
    keepRecord();

    result.provenance = "servocal-calibrate, " + arm.provenance() + (resume.empty() ? "" : ", resumed");
    session::saveResult(out / "result.yaml", result);
    (json ? std::cerr : std::cout) << procedure::summary(result) << "Wrote " << (out / "result.yaml").string()
                                   << " and the session in " << out.string() << '\n';
    if (json) std::cout << session::resultJson(result);
    if (page) page->finish(result.goal_met, procedure::verdict(result));
    return static_cast<int>(result.goal_met ? app::kOk : app::kGoalNotMet);
  });
}
