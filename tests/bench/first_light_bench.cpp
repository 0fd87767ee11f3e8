// SPDX-License-Identifier: GPL-3.0-or-later
// Calibrates the default cell over seeds 1..N and prints one row each against the truth.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "trial.h"

int main(int argc, char** argv) {
  using namespace servocal;
  const int seeds = argc > 1 ? std::stoi(argv[1]) : 5;
  const int first_seed = argc > 2 ? std::stoi(argv[2]) : 1;
  const CellConfig cell = argc > 3 ? loadCell(argv[3]) : defaultCell();
  const auto folder = std::filesystem::temp_directory_path() / "servocal-first-light";
  std::printf("seed goal reachable filled views  obs lost motion_s tilt_s wall_s cpu_s  camera_mm camera_deg "
              "board_mm(median of 5, worst)  Zhang_px\n");
  std::vector<double> camera_mm, camera_deg;
  for (int seed = first_seed; seed < first_seed + seeds; ++seed) {
    std::filesystem::remove_all(folder);
    const test::Trial trial = test::runTrial(cell, seed, folder);
    auto board = trial.board_point_error_m;
    std::sort(board.begin(), board.end());
    camera_mm.push_back(trial.camera_error_m * 1e3);
    camera_deg.push_back(trial.camera_error_rad * 180 / M_PI);
    std::printf("%4d %4s %6d/%2d %6d %5d %4d %4d %8.1f %6.1f %6.1f %5.1f %10.2f %10.3f %8.2f %8.2f %12.3f\n", seed,
                trial.result.goal_met ? "yes" : "no", trial.reachable_cells, trial.cells,
                trial.filled_reachable_cells, trial.coverage_views, trial.result.observations, trial.target_losses,
                trial.result.motion_time_s, trial.result.tilt_time_s, trial.wall_s, trial.cpu_s, camera_mm.back(),
                camera_deg.back(), board[2] * 1e3, board[4] * 1e3,
                trial.result.cameras.empty() ? NAN : trial.result.cameras.front().intrinsics.rms_px);
    for (const std::string& missing : trial.result.missing) std::printf("     missing: %s\n", missing.c_str());
    std::fflush(stdout);
  }
  std::sort(camera_mm.begin(), camera_mm.end());
  std::sort(camera_deg.begin(), camera_deg.end());
  std::printf("median %.2f mm %.3f deg, worst %.2f mm %.3f deg\n", camera_mm[camera_mm.size() / 2],
              camera_deg[camera_deg.size() / 2], camera_mm.back(), camera_deg.back());
  std::filesystem::remove_all(folder);
}
