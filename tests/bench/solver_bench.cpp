// SPDX-License-Identifier: GPL-3.0-or-later
// Our solvers beside OpenCV's and ViSP's on the same views: error against the truth (of recordings: in views held
// out) and CPU time.
//
//   solver_bench [SEEDS [all|parts|sessions|recordings [RECORDINGS]]]     (default 10 all)
//
// RECORDINGS is the folder of test recordings that the manifests in tests/data/manifests start at.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <opencv2/calib3d.hpp>
#include <string>
#include <vector>

#include "calib_scene.h"
#include "hand_eye_peers.h"
#include "servocal/calib/board_pose.h"
#include "servocal/calib/hand_eye.h"
#include "servocal/calib/intrinsics.h"
#include "servocal/calib/reprojection.h"
#include "solver_sessions.h"

namespace servocal {
namespace {

using test::opencvHandEye;
using test::opencvRobotWorld;
using test::Stops;

double cpuMs() { return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

double median(std::vector<double> values) {
  if (values.empty()) return NAN;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

struct Row {
  std::vector<double> first_error, second_error, ms;
  int failed = 0;
};

// ---------------------------------------------------------------- intrinsics

struct Corners {
  std::vector<std::vector<cv::Point3f>> points;
  std::vector<std::vector<cv::Point2f>> pixels;
};

Corners cornersOf(const test::Scene& scene) {
  Corners out;
  for (const Observation& observation : scene.observations) {
    out.points.emplace_back();
    out.pixels.emplace_back();
    for (const Corner& corner : observation.views[0].detection.corners) {
      const Eigen::Vector3d point = scene.board.corner(corner.id);
      out.points.back().emplace_back(point.x(), point.y(), 0.f);
      out.pixels.back().emplace_back(corner.pixel.x(), corner.pixel.y());
    }
  }
  return out;
}

void benchIntrinsics(int seeds) {
  std::printf("\nIntrinsics, 1920x1080, 24 corners, 0.1 px: median |error of fx| (px), RMS (px), CPU ms\n");
  std::printf("%6s  %-28s %10s %10s %10s\n", "views", "solver", "fx", "rms", "ms");
  for (const int views : {10, 20, 40, 80}) {
    Row ours, opencv;
    for (int seed = 1; seed <= std::min(seeds, 5); ++seed) {  // OpenCV takes seconds each
      test::SceneOptions options;
      options.views = views;
      options.noise.corner_px = 0.1;
      const test::Scene scene = test::makeScene(seed, options);
      double start = cpuMs();
      const auto outcome = calib::solveIntrinsics(scene.board, scene.observations, test::kCamera, Stream::kColor);
      ours.ms.push_back(cpuMs() - start);
      if (outcome.result) {
        ours.first_error.push_back(std::abs(outcome.result->camera.fx() - scene.camera.fx()));
        ours.second_error.push_back(outcome.result->rms_px);
      } else {
        ++ours.failed;
      }
      const Corners corners = cornersOf(scene);
      cv::Mat matrix, distortion;
      std::vector<cv::Mat> rotations, translations;
      start = cpuMs();
      opencv.second_error.push_back(cv::calibrateCamera(corners.points, corners.pixels, {1920, 1080}, matrix,
                                                        distortion, rotations, translations));
      opencv.ms.push_back(cpuMs() - start);
      opencv.first_error.push_back(std::abs(matrix.at<double>(0, 0) - scene.camera.fx()));
    }
    std::printf("%6d  %-28s %10.3f %10.4f %10.2f  (failed %d)\n", views, "servocal", median(ours.first_error),
                median(ours.second_error), median(ours.ms), ours.failed);
    std::printf("%6d  %-28s %10.3f %10.4f %10.2f  (%.0f x our time)\n", views, "cv::calibrateCamera",
                median(opencv.first_error), median(opencv.second_error), median(opencv.ms),
                median(opencv.ms) / median(ours.ms));
  }
}

// ------------------------------------------------------------------ hand-eye

void benchHandEye(int seeds, Mount mount) {
  std::printf("\nHand-eye, camera %s, 0.2 px, robot 0.29 mm and 0.5 mrad per axis, intrinsics known:\n"
              "mean and worst error over the workspace (mm), median angle (deg), CPU ms; closed forms get our "
              "board poses, whose time is not counted\n",
              mount == Mount::kFixed ? "fixed in the cell" : "on the flange");
  std::printf("%6s  %-28s %9s %9s %9s %9s\n", "views", "solver", "mean mm", "worst mm", "deg", "ms");
  using Solver = std::function<std::optional<Eigen::Isometry3d>(const test::Scene&, const Stops&)>;
  const auto reprojection = [&](bool believed) -> Solver {
    return [=](const test::Scene& scene, const Stops&) -> std::optional<Eigen::Isometry3d> {
      calib::ReprojectionOptions options;
      options.mount = mount;
      if (believed) options.robot_sigma_m = options.robot_sigma_rad = 1e-7;
      const auto outcome = calib::solveHandEyeReprojection(scene.board, scene.camera, scene.observations,
                                                           test::kCamera, Stream::kColor, options);
      if (!outcome.solution) return std::nullopt;
      return outcome.solution->camera_pose;
    };
  };
  const std::vector<std::pair<std::string, Solver>> solvers = {
      {"servocal reprojection", reprojection(false)},
      {"servocal, robot believed", reprojection(true)},
      {"servocal closed form",
       [](const test::Scene&, const Stops& stops) -> std::optional<Eigen::Isometry3d> {
         std::vector<calib::HandEyeView> views;
         for (std::size_t i = 0; i < stops.lMr.size(); ++i) views.push_back({stops.lMr[i], stops.cMo[i]});
         const auto result = calib::solveHandEye(views);
         if (!result.bMc) return std::nullopt;
         return result.bMc->isometry();
       }},
      {"cv Tsai", [](const auto&, const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_TSAI); }},
      {"cv Park", [](const auto&, const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_PARK); }},
      {"cv Horaud", [](const auto&, const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_HORAUD); }},
      {"cv Andreff", [](const auto&, const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_ANDREFF); }},
      {"cv Daniilidis",
       [](const auto&, const Stops& s) { return opencvHandEye(s, cv::CALIB_HAND_EYE_DANIILIDIS); }},
      {"cv Shah",
       [](const auto&, const Stops& s) { return opencvRobotWorld(s, cv::CALIB_ROBOT_WORLD_HAND_EYE_SHAH); }},
      {"cv Li",
       [](const auto&, const Stops& s) { return opencvRobotWorld(s, cv::CALIB_ROBOT_WORLD_HAND_EYE_LI); }},
  };
  for (const int views : {7, 14, 40, 80}) {
    std::vector<Row> rows(solvers.size());
    for (int seed = 1; seed <= seeds; ++seed) {
      test::SceneOptions options;
      options.views = views;
      options.mount = mount;
      options.noise = {0.2, 0.0005 / std::sqrt(3.0), 0.0005};
      const test::Scene scene = test::makeScene(900 + seed, options);
      Stops stops;
      for (const Observation& observation : scene.observations) {
        const auto poses = calib::boardPoses(scene.board, scene.camera, observation.views[0].detection);
        if (poses.empty()) continue;
        const auto& bMe = observation.robot->bMe;
        stops.lMr.push_back(mount == Mount::kFixed ? bMe : relabel<Base, EndEffector>(bMe.inverse()));
        stops.cMo.push_back(poses[0].cMo);
      }
      for (std::size_t i = 0; i < solvers.size(); ++i) {
        const double start = cpuMs();
        std::optional<Eigen::Isometry3d> estimate;
        try {
          estimate = solvers[i].second(scene, stops);
        } catch (const cv::Exception&) {
        }
        rows[i].ms.push_back(cpuMs() - start);
        if (!estimate || !estimate->matrix().allFinite()) {
          ++rows[i].failed;
          continue;
        }
        double sum_mm = 0;
        for (const auto& cMo : scene.cMo) {
          sum_mm += 1e3 * (*estimate * cMo.translation() - scene.camera_pose * cMo.translation()).norm();
        }
        rows[i].first_error.push_back(sum_mm / static_cast<double>(scene.cMo.size()));
        rows[i].second_error.push_back(
            angleRad(Pose<Base, Color>(*estimate), Pose<Base, Color>(scene.camera_pose)) * 180 / M_PI);
      }
    }
    for (std::size_t i = 0; i < solvers.size(); ++i) {
      double mean = 0, worst = 0;
      for (const double error : rows[i].first_error) {
        mean += error / static_cast<double>(rows[i].first_error.size());
        worst = std::max(worst, error);
      }
      std::printf("%6d  %-28s %9.3f %9.3f %9.4f %9.2f", views, solvers[i].first.c_str(), mean, worst,
                  median(rows[i].second_error), median(rows[i].ms));
      std::printf(rows[i].failed ? "  (failed %d)\n" : "\n", rows[i].failed);
    }
  }
}

}  // namespace
}  // namespace servocal

int main(int argc, char** argv) {
  const int seeds = argc > 1 ? std::atoi(argv[1]) : 10;
  const std::string part = argc > 2 ? argv[2] : "all", root = argc > 3 ? argv[3] : "";
  if (seeds < 1 || (part == "recordings" && root.empty())) {
    std::fprintf(stderr, "usage: solver_bench [SEEDS [all|parts|sessions|recordings [RECORDINGS]]]\n");
    return 2;
  }
  if (part == "all" || part == "parts") {
    servocal::benchIntrinsics(seeds);
    servocal::benchHandEye(seeds, servocal::Mount::kFixed);
    servocal::benchHandEye(seeds, servocal::Mount::kFlange);
  }
  if (part == "all" || part == "sessions") {
    servocal::test::benchSessions(seeds, servocal::Mount::kFixed);
    servocal::test::benchSessions(seeds, servocal::Mount::kFlange);
  }
  if (!root.empty() && (part == "all" || part == "recordings")) servocal::test::benchRecordings(root);
  return 0;
}
