// SPDX-License-Identifier: GPL-3.0-or-later
// Calibrates a simulated cell of one camera over seeds 1..N and prints one row each against the truth.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "cells.h"
#include "trial.h"

namespace {

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? std::nan("") : values[values.size() / 2];
}

double largest(const std::vector<double>& values) {
  return values.empty() ? std::nan("") : *std::max_element(values.begin(), values.end());
}

}  // namespace

int main(int argc, char** argv) {
  using namespace servocal;
  CLI::App cli("Calibrates a simulated cell over several seeds; prints what came out against the truth.",
               "calibrate_bench");
  int seeds = 5, first_seed = 1;
  std::string cell_file, board_file;
  cli.add_option("--seeds", seeds, "How many")->capture_default_str();
  cli.add_option("--first", first_seed, "The first one")->capture_default_str();
  cli.add_option("--cell", cell_file, "Cell file; the one-camera cell of the tests if not given");
  cli.add_option("--board", board_file, "Board file, in place of the cell's board");
  CLI11_PARSE(cli, argc, argv);

  CellConfig cell = cell_file.empty() ? test::oneCameraCell() : loadCell(cell_file);
  if (!board_file.empty()) cell.board = loadBoard(board_file);
  const auto folder = std::filesystem::temp_directory_path() / ("servocal-bench-" + std::to_string(getpid()));
  std::printf("%s, board: %s\n", cell_file.empty() ? "one-camera cell" : cell_file.c_str(),
              cell.board.describe().c_str());
  std::printf("seed goal reachable filled views  obs lost motion_s tilt_s wall_s cpu_s  camera_mm camera_deg "
              "board_mm(median of 5, worst)  Zhang_px\n");
  std::vector<double> camera_mm, camera_deg, lost, motion_s, cpu_s;
  int met = 0;
  for (int seed = first_seed; seed < first_seed + seeds; ++seed) {
    std::filesystem::remove_all(folder);
    const test::Trial trial = test::runTrial(cell, seed, folder);
    auto board = trial.board_point_error_m;
    std::sort(board.begin(), board.end());
    camera_mm.push_back(trial.camera_error_m * 1e3);
    camera_deg.push_back(trial.camera_error_rad * 180 / M_PI);
    lost.push_back(trial.target_losses);
    motion_s.push_back(trial.result.motion_time_s);
    cpu_s.push_back(trial.cpu_s);
    met += trial.result.goal_met;
    std::printf("%4d %4s %6d/%2d %6d %5d %4d %4d %8.1f %6.1f %6.1f %5.1f %10.2f %10.3f %8.2f %8.2f %12.3f\n", seed,
                trial.result.goal_met ? "yes" : "no", trial.reachable_cells, trial.cells,
                trial.filled_reachable_cells, trial.coverage_views, trial.result.observations, trial.target_losses,
                trial.result.motion_time_s, trial.result.tilt_time_s, trial.wall_s, trial.cpu_s, camera_mm.back(),
                camera_deg.back(), board[2] * 1e3, board[4] * 1e3,
                trial.result.cameras.empty() ? NAN : trial.result.cameras.front().intrinsics.rms_px);
    for (const std::string& missing : trial.result.missing) std::printf("     missing: %s\n", missing.c_str());
    std::fflush(stdout);
  }
  std::printf("goal met %d of %d; median %.2f mm %.3f deg, worst %.2f mm %.3f deg; motion median %.0f s, worst %.0f s; "
              "target lost outside the tilt search median %.0f, worst %.0f; CPU median %.0f s\n",
              met, seeds, median(camera_mm), median(camera_deg), largest(camera_mm), largest(camera_deg),
              median(motion_s), largest(motion_s), median(lost), largest(lost), median(cpu_s));
  std::filesystem::remove_all(folder);
}
