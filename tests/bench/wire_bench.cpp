// SPDX-License-Identifier: GPL-3.0-or-later
// Runs servocal-calibrate on a cell whose arm is behind a simulated Universal Robots controller and whose
// cameras are behind OpenNI2, as an operator does, and prints every camera against the truth, in the columns
// of cell_bench.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <string>

#include "servocal/session/session.h"
#include "servocal/sim/cell.h"
#include "trial.h"
#include "ur_program.h"

namespace {

using namespace servocal;

constexpr char kFakeTime[] = "/usr/lib/x86_64-linux-gnu/faketime/libfaketimeMT.so.1";

/// Runs the program as an operator does; its session is in `out` then.
void calibrate(const std::string& cell_file, std::uint64_t seed, double pace,
               const std::filesystem::path& out) {
  std::string program = SERVOCAL_CALIBRATE;
  if (pace < 1.0)
    program = "env LD_PRELOAD=" + std::string(kFakeTime) + " 'FAKETIME=+0 x" + std::to_string(pace) + "' " +
              program;
  const auto begin = std::chrono::steady_clock::now();
  test::TerminalProgram terminal(test::urCommand(program, cell_file, seed, out));
  if (terminal.waitFor(test::kUrPrompt, 120.0 / pace)) terminal.type(test::kUrSerial);
  const int exit_code = terminal.end(3600.0 / pace);
  std::cerr << terminal.screen();
  const double wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  double load[1] = {0.0};
  ::getloadavg(load, 1);
  std::printf("exit code %d after %.0f s at a pace of %.2f; load of the computer at the end %.1f\n",
              exit_code, wall_s, pace, load[0]);
}

void print(const CellConfig& config, std::uint64_t seed, const CalibrationResult& result) {
  std::printf("seed %llu: goal %s, %d observations, robot time %.1f s, tilt search %.1f s\n",
              static_cast<unsigned long long>(seed), result.goal_met ? "met" : "not met", result.observations,
              result.motion_time_s, result.tilt_time_s);
  std::printf("camera  pose_mm pose_deg  cMi_mm cMi_deg  depth_mm before  after  beyond\n");
  sim::Cell cell(test::withoutController(config), seed);
  const double nothing = std::nan(""), deg_per_rad = 180.0 / M_PI;
  for (const test::CameraErrors& camera : test::cameraErrors(cell, result)) {
    std::printf("%-6s %8.3f %8.3f %7.3f %7.3f %16.3f %6.3f %7.3f\n", camera.camera.c_str(),
                1e3 * camera.pose_m, deg_per_rad * camera.pose_rad, 1e3 * camera.infrared_m.value_or(nothing),
                deg_per_rad * camera.infrared_rad.value_or(nothing),
                1e3 * camera.depth_before_m.value_or(nothing), 1e3 * camera.depth_after_m.value_or(nothing),
                1e3 * camera.depth_beyond_m.value_or(nothing));
  }
  for (const std::string& missing : result.missing) std::printf("missing: %s\n", missing.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli(
      "Calibrates a cell through OpenNI2 and RTDE, in real time; prints every camera against the truth.",
      "wire_bench");
  std::string cell_file = SERVOCAL_CELLS "/ur_paper.yaml";
  std::filesystem::path result;
  std::uint64_t seed = 1;
  double pace = 1.0;
  cli.add_option("--cell", cell_file, "Cell file")->capture_default_str();
  cli.add_option("--seed", seed, "Of the simulation")->capture_default_str();
  cli.add_option("--pace", pace,
                 "Of the program's and the controller's clocks; below 1 for a computer too slow or too busy "
                 "to render "
                 "in real time. Needs libfaketime (Debian's package faketime)")
      ->check(CLI::Range(0.05, 1.0))
      ->capture_default_str();
  cli.add_option("--result", result, "Only print this result of an earlier run with this cell and seed")
      ->check(CLI::ExistingFile);
  CLI11_PARSE(cli, argc, argv);
  const test::TemporaryFolder folder;
  if (result.empty()) {
    calibrate(cell_file, seed, pace, folder / "session");
    result = folder / "session" / "result.yaml";
  }
  if (!std::filesystem::exists(result)) return 1;
  print(loadCell(cell_file), seed, session::loadResult(result));
}
