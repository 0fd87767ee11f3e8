// SPDX-License-Identifier: GPL-3.0-or-later
// The numbers of docs/residuals.md: what a residual hides, on synthetic views with a known truth.
//
//   residual_primer [SEEDS]     (default 40)
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <tuple>
#include <vector>

#include "calib_scene.h"
#include "servocal/calib/board_pose.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/calib/reprojection.h"

namespace servocal {
namespace {

/// Root mean square.
struct Rms {
  double squares = 0;
  int count = 0;
  void add(double value) {
    squares += value * value;
    ++count;
  }
  double value() const { return count > 0 ? std::sqrt(squares / count) : NAN; }
};

struct Trial {
  int views = 20;
  double corner_px = 0.1;
  double max_tilt_rad = 0.7;
  calib::IntrinsicsOptions options;
  double stated_scale = 1.0;  ///< Stated size of the squares over the true one.
};

test::Scene sceneOf(const Trial& trial, int seed) {
  test::SceneOptions options;
  options.views = trial.views;
  options.max_tilt_rad = trial.max_tilt_rad;
  options.noise.corner_px = trial.corner_px;
  return test::makeScene(static_cast<std::uint64_t>(seed), options);
}

/// Residual of views that had no part in the solve, each board pose fitted anew.
double heldOutPx(const CameraModel& camera, int seed, double corner_px) {
  Trial other;
  other.corner_px = corner_px;
  const test::Scene scene = sceneOf(other, 100000 + seed);
  Rms rms;
  for (const Observation& observation : scene.observations) {
    const auto poses = calib::boardPoses(scene.board, camera, observation.views[0].detection);
    if (!poses.empty()) rms.add(poses.front().rms_px);
  }
  return rms.value();
}

void printIntrinsics(const std::string& name, const Trial& trial, int seeds) {
  Rms residual, error, sigma, held_out, distance;
  int refused = 0;
  for (int seed = 1; seed <= seeds; ++seed) {
    const test::Scene scene = sceneOf(trial, seed);
    BoardSpec stated = scene.board;
    std::get<Checkerboard>(stated.pattern).square_size_m *= trial.stated_scale;
    const auto outcome =
        calib::solveIntrinsics(stated, scene.observations, test::kCamera, Stream::kColor, trial.options);
    if (!outcome.result) {
      ++refused;
      continue;
    }
    residual.add(outcome.result->rms_px);
    error.add(outcome.result->camera.fx() - scene.camera.fx());
    sigma.add(outcome.result->sigma[0]);
    held_out.add(heldOutPx(outcome.result->camera, seed, trial.corner_px));
    for (std::size_t i = 0; i < scene.cMo.size(); ++i) {
      const auto poses =
          calib::boardPoses(stated, outcome.result->camera, scene.observations[i].views[0].detection);
      if (!poses.empty())
        distance.add(1e3 * (poses.front().cMo.translation() - scene.cMo[i].translation()).norm());
    }
  }
  std::printf("| %-34s | %8.4f | %8.4f | %8.2f | %8.2f | %8.2f | %3d |\n", name.c_str(), residual.value(),
              held_out.value(), error.value(), sigma.value(), distance.value(), refused);
}

void head(const char* title) {
  std::printf(
      "\n%s\n\n| %-34s | residual | held out | fx error | fx sigma | board mm | refused |\n"
      "|---|---|---|---|---|---|---|\n",
      title, "");
}

void printHandEye(const std::string& name, double robot_m, double focal_error, int seeds) {
  Rms residual, scatter, error, sigma;
  for (int seed = 1; seed <= seeds; ++seed) {
    test::SceneOptions options;
    options.views = 20;
    options.noise = {0.1, robot_m, robot_m / 0.6};  // a turn that moves the camera's view by as much at 0.6 m
    const test::Scene scene = test::makeScene(static_cast<std::uint64_t>(seed), options);
    CameraModel camera = scene.camera;
    camera.parameters.head<2>() *= 1.0 + focal_error;
    calib::ReprojectionOptions solve;
    solve.robot_sigma_m = std::max(robot_m, 1e-4);
    solve.robot_sigma_rad = solve.robot_sigma_m / 0.6;
    const auto outcome = calib::solveHandEyeReprojection(scene.board, camera, scene.observations,
                                                         test::kCamera, Stream::kColor, solve);
    if (!outcome.solution) continue;
    residual.add(outcome.solution->rms_px);
    scatter.add(1e3 * outcome.solution->scatter_m);
    error.add(1e3 * (outcome.solution->camera_pose.translation() - scene.camera_pose.translation()).norm());
    sigma.add(1e3 * outcome.solution->camera_sigma.head<3>().norm());
  }
  std::printf("| %-34s | %8.4f | %8.2f | %8.2f | %8.2f |\n", name.c_str(), residual.value(), scatter.value(),
              error.value(), sigma.value());
}

}  // namespace
}  // namespace servocal

int main(int argc, char** argv) {
  using namespace servocal;
  const int seeds = argc > 1 ? std::atoi(argv[1]) : 40;
  if (seeds < 1) {
    std::fprintf(stderr, "usage: residual_primer [SEEDS]\n");
    return 2;
  }
  std::printf(
      "Camera of 1920 x 1080 px, fx 1066 px; board of 7 x 5 squares of 30 mm at 0.45 to 0.75 m. Root mean\n"
      "squares over %d seeds; residuals and fx in px, error of the board's position in mm.\n",
      seeds);

  head("Corners measured to 0.1 px, more and more views");
  for (const int views : {4, 5, 10, 20, 50}) {
    Trial trial;
    trial.views = views;
    printIntrinsics(std::to_string(views) + " views", trial, seeds);
  }

  head("20 views, 0.1 px, tilted less and less");
  for (const double tilt_deg : {40.0, 20.0, 10.0, 5.0}) {
    Trial trial;
    trial.max_tilt_rad = tilt_deg * M_PI / 180;
    printIntrinsics("tilted up to " + std::to_string(static_cast<int>(tilt_deg)) + " deg", trial, seeds);
  }

  head("4 views, 0.1 px, more and more parameters");
  for (const auto& [name, fixed, lens] :
       {std::tuple<const char*, std::vector<std::string>, LensModel>{
            "fx fy cx cy k1 (5)", {"k2", "p1", "p2", "k3"}, LensModel::kPlumbBob},
        {"... k2 p1 p2 (8)", {"k3"}, LensModel::kPlumbBob},
        {"... k3 (9)", {}, LensModel::kPlumbBob},
        {"... k4 k5 k6 (12)", {}, LensModel::kRational}}) {
    Trial trial;
    trial.views = 4;
    trial.options.fixed = fixed;
    trial.options.lens = lens;
    printIntrinsics(name, trial, seeds);
  }

  head("20 views, 0.1 px, the squares stated wrongly");
  for (const double scale : {1.0, 1.01, 1.2}) {
    Trial trial;
    trial.stated_scale = scale;
    char name[40];
    std::snprintf(name, sizeof name, "stated %.1f mm, are 30 mm", 30 * scale);
    printIntrinsics(name, trial, seeds);
  }

  std::printf(
      "\nHand-eye, 20 views, 0.1 px: residual px, scatter mm, error and claimed sigma of the camera's "
      "position mm\n\n"
      "| %-34s | residual | scatter | error | sigma |\n|---|---|---|---|---|\n",
      "");
  printHandEye("exact robot, exact camera", 0.0, 0.0, seeds);
  printHandEye("robot off by 0.3 mm", 0.0003, 0.0, seeds);
  printHandEye("robot off by 3 mm", 0.003, 0.0, seeds);
  printHandEye("robot off by 0.3 mm, fx by 1 %", 0.0003, 0.01, seeds);
  return 0;
}
