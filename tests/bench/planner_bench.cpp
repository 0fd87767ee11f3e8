// SPDX-License-Identifier: GPL-3.0-or-later
// How many views a planner needs until the joint estimate is good enough, for three planners: by information,
// by coverage alone, at random. Geometry and covariances only: no images, every drive arrives, corners
// and arm as good as said. What is counted is the covariance that a solve of exactly these views would
// claim at the truth.
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <random>

#include "fake_arm.h"
#include "joint_scene.h"
#include "servocal/calib/uncertainty.h"
#include "servocal/plan/informative_views.h"
#include "servocal/robot/guard.h"
#include "servocal/sim/cell.h"
#include "sim_truth.h"

namespace {

using namespace servocal;

constexpr double kRangeM = 0.54;
constexpr int kMostViews = 120;
constexpr double kGoalPx = 0.35, kGoalM = 0.0005;

double cpuMs() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return 1e3 * (usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
         1e-3 * (usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

struct Known {
  double projection_px = 0.0, point_m = 0.0;
};

/// A cell, and what is true of it.
struct Scene {
  Scene(const CellConfig& drawn, std::uint64_t seed, int cameras, bool infrared, double robot_m, double corner_px)
      : cell(drawn), noise{corner_px, robot_m, 2.5 * robot_m} {
    sim::Cell simulation(cell, seed);
    const sim::Truth known(simulation);
    truth.board = cell.board;
    truth.board_pose = known.eMo().isometry();
    for (int i = 0; i < cameras; ++i) {
      const std::string& name = cell.cameras[static_cast<std::size_t>(i)].name;
      const Pose<Base, Color> bMc = known.bMc(name);
      truth.cameras.push_back({name, Stream::kColor, known.camera(name), bMc.isometry()});
      if (infrared) {
        truth.cameras.push_back(
            {name, Stream::kInfrared, known.infrared(name), (bMc * known.cMi(name)).isometry()});
      }
    }
    guard.setBoard(known.eMo());
    calib::JointOptions options;
    options.board.bow = false;
    options.robot_sigma_m = noise.robot_m;
    options.robot_sigma_rad = noise.robot_rad;
    for (const test::CellCamera& camera : truth.cameras) {
      calib::JointStream stream;
      stream.camera = camera.name;
      stream.stream = camera.stream;
      const CameraModel& model = camera.model;
      stream.prior = calib::nominalPrior(CameraModel::fromFieldOfView(
          model.width_px, model.height_px, 2.0 * std::atan(0.5 * model.width_px / model.fx())));
      options.streams.push_back(stream);
    }
    // Three views of each: facing, and leaning by 40 degrees about two axes.
    for (const test::CellCamera& camera : truth.cameras) {
      for (const Eigen::Vector3d& lean :
           {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0.7, 0, 0), Eigen::Vector3d(0, -0.7, 0)}) {
        const auto cMo = Pose<Color, Board>::fromRotationVector(lean, {0, 0, 0.55});
        take(Pose<Base, EndEffector>(camera.pose * cMo.isometry() * truth.board_pose.inverse()));
      }
    }
    at = test::truthLike(calib::solveJoint(cell.board, observations, options).solution.value(), truth, noise);
    for (calib::JointCamera& camera : at.cameras) camera.rms_px = corner_px * std::sqrt(2.0);
    renew();
  }

  void take(const Pose<Base, EndEffector>& bMe) {
    observations.push_back(
        test::observe(truth, {bMe, {}}, static_cast<std::int64_t>(observations.size()) + 1, noise, random));
  }
  void renew() { at.covariance = calib::jointCovarianceAt(cell.board, observations, at); }

  Known known() const {
    Known known;
    for (const calib::JointCamera& camera : at.cameras) {
      for (const std::optional<double> distance_m :
           {std::optional<double>(), std::optional<double>(kRangeM)}) {
        known.projection_px = std::max(
            known.projection_px, calib::projectionMap(at, camera, calib::Anchor::kBase, distance_m).worst_px);
      }
      known.point_m = std::max(known.point_m, calib::workspaceMap(at, camera, cell.limits.workspace).worst_m);
    }
    return known;
  }

  plan::Belief belief(std::size_t camera) const {
    return {at.cameras[camera].model, Pose<Base, Color>(at.cameras[camera].pose),
            Pose<EndEffector, Board>(at.board_pose), Mount::kFixed};
  }

  CellConfig cell;
  test::Noise noise;
  test::Cell truth;
  SimulatedClock clock;
  robot::Kinematics kinematics{cell.arm};
  test::FakeArm arm{kinematics, clock, cell.arm.start_q};
  robot::Guard guard{arm, kinematics, clock, cell.limits, cell.board};
  std::mt19937_64 random{5};
  std::vector<Observation> observations;
  calib::JointSolution at;
};

/// The next stops by some planner; none if it knows no more.
using Chooser = std::function<std::vector<Pose<Base, EndEffector>>(Scene&, const Eigen::VectorXd& q)>;

coverage::Coverage floorOf(const Scene& scene, const CameraModel& model) {
  CoverageConfig config = scene.cell.coverage;
  config.cells_x = 4;
  config.cells_y = 3;
  config.corners_per_cell = 6;
  return {config, {0, 0, model.width_px, model.height_px}, {2, 2, 1}};
}

std::vector<Eigen::Vector2d> pixelsOf(const plan::Belief& belief, const BoardSpec& board,
                                      const Pose<Color, Board>& cMo) {
  std::vector<Eigen::Vector2d> pixels;
  for (const Eigen::Vector3d& corner : board.corners()) {
    if (const auto pixel = belief.camera.project(cMo * corner)) pixels.push_back(*pixel);
  }
  return pixels;
}

struct ByInformation {
  std::vector<coverage::Coverage> floors;
  std::vector<plan::Viewer> viewers;
  plan::InformativeOptions options;
  double cpu_ms = 0.0;
  int plans = 0;

  ByInformation(const Scene& scene, const plan::InformativeOptions& wanted) : options(wanted) {
    options.near_m = scene.cell.coverage.near_distance_m;
    for (std::size_t i = 0; i < scene.at.cameras.size(); ++i)
      floors.push_back(floorOf(scene, scene.at.cameras[i].model));
    for (std::size_t i = 0; i < scene.at.cameras.size(); ++i) {
      const plan::Belief belief = scene.belief(i);
      viewers.push_back({i,
                         belief,
                         plan::Detectability(scene.cell.board, belief.camera),
                         &floors[i],
                         {},
                         scene.at.cameras[i].camera,
                         true,
                         true,
                         0.012 * belief.camera.height_px});
    }
  }

  std::vector<Pose<Base, EndEffector>> operator()(Scene& scene, const Eigen::VectorXd& q) {
    options.draw = plans;
    const double before_ms = cpuMs();
    const calib::Forecast forecast(scene.cell.board, scene.at,
                                   {scene.cell.limits.workspace, kRangeM, kGoalPx, kGoalM});
    const auto next = plan::informativeView(forecast, viewers, scene.cell.board, scene.guard, q, options);
    cpu_ms += cpuMs() - before_ms;
    ++plans;
    if (!next) return {};
    viewers[next->viewer].tried.push_back(next->cdMo);
    for (const calib::PlannedStop::Look& look : next->stop.looks) {
      const plan::Belief& belief = viewers[look.camera].belief;
      const Pose<Color, Board> cMo = belief.bMc.inverse() * next->bMe * belief.eMo;
      floors[look.camera].add(pixelsOf(belief, scene.cell.board, cMo), cMo);
    }
    return {next->bMe};
  }
};

/// Camera after camera; begins anew when all is covered.
struct ByCoverage {
  std::vector<coverage::Coverage> covered;
  std::vector<std::vector<Pose<Color, Board>>> tried;
  std::size_t turn = 0;

  void begin(const Scene& scene) {
    covered.clear();
    for (const calib::JointCamera& camera : scene.at.cameras) {
      CoverageConfig config = scene.cell.coverage;
      if (camera.stream == Stream::kInfrared) config.cells_x = config.infrared_cells_x;
      covered.emplace_back(config, ImageRegion{0, 0, camera.model.width_px, camera.model.height_px});
    }
    tried.resize(covered.size());
    turn = 0;
  }

  std::vector<Pose<Base, EndEffector>> operator()(Scene& scene, const Eigen::VectorXd& q) {
    if (covered.empty()) begin(scene);
    for (int rounds = 0; rounds < 2;) {
      if (turn == covered.size()) {
        begin(scene);
        ++rounds;
      }
      coverage::Coverage& mine = covered[turn];
      const plan::Belief belief = scene.belief(turn);
      plan::PlanOptions options;
      const CoverageConfig& config = scene.cell.coverage;
      options.distances_m = {config.near_distance_m, 1.08 * config.distance_ratio * config.near_distance_m,
                             1.3 * config.distance_ratio * config.near_distance_m};
      options.image_margin_px = 0.022 * belief.camera.height_px;
      const plan::NextView next = plan::nextView(mine, belief, scene.cell.board, scene.guard, q,
                                                 scene.cell.arm.start_q, tried[turn], options);
      for (const int cell : next.unreachable) mine.giveUp(cell);
      if (!next.view || mine.complete()) {
        ++turn;
        continue;
      }
      tried[turn].push_back(next.view->cdMo);
      for (std::size_t i = 0; i < covered.size(); ++i) {
        const plan::Belief other = scene.belief(i);
        const Pose<Color, Board> cMo = other.bMc.inverse() * next.view->bMe * other.eMo;
        const auto pixels = pixelsOf(other, scene.cell.board, cMo);
        const bool whole = pixels.size() == scene.cell.board.corners().size() &&
                           std::all_of(pixels.begin(), pixels.end(),
                                       [&](const auto& p) { return other.camera.contains(p, 5.0); });
        if (whole) covered[i].add(pixels, cMo);
      }
      return {next.view->bMe};
    }
    return {};
  }
};

struct AtRandom {
  std::mt19937_64 random;
  std::vector<Pose<Base, EndEffector>> operator()(Scene& scene, const Eigen::VectorXd& q) {
    std::uniform_real_distribution<double> uniform;
    for (int i = 0; i < 20000; ++i) {
      const plan::Belief belief = scene.belief(random() % scene.at.cameras.size());
      const Eigen::Vector2d pixel(uniform(random) * belief.camera.width_px,
                                  uniform(random) * belief.camera.height_px);
      const auto ray = belief.camera.unproject(pixel);
      if (!ray) continue;
      const double towards = 2 * M_PI * uniform(random), tilt = M_PI / 4 * uniform(random);
      const Eigen::Matrix3d turned =
          (Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(towards), std::sin(towards), 0)) *
           Eigen::AngleAxisd(M_PI / 2 * (uniform(random) - 0.5), Eigen::Vector3d::UnitZ()))
              .toRotationMatrix();
      const Pose<Color, Board> cMo(turned, (0.45 + 0.36 * uniform(random)) * ray->homogeneous());
      bool whole = true;
      for (const Eigen::Vector3d& point : scene.cell.board.patternOutline()) {
        const auto seen = belief.camera.project(cMo * point);
        whole = whole && seen && belief.camera.contains(*seen, 10.0);
      }
      if (!whole) continue;
      const Pose<Base, EndEffector> bMe = belief.bMc * cMo * belief.eMo.inverse();
      const auto there = scene.guard.kinematics().inverse(bMe, q, scene.guard.limits().joint_margin_rad);
      if (there && scene.guard.allows(*there)) return {bMe};
    }
    return {};
  }
};

struct Course {
  std::vector<Known> after;  ///< By number of views, from 0 on.
  std::vector<double> travel_s;
};

Course run(Scene& scene, const Chooser& choose, int most_views) {
  Course course;
  course.after.push_back(scene.known());
  course.travel_s.push_back(0.0);
  Eigen::VectorXd q = scene.cell.arm.start_q;
  while (static_cast<int>(course.after.size()) <= most_views) {
    const auto stops = choose(scene, q);
    if (stops.empty()) break;
    for (const Pose<Base, EndEffector>& bMe : stops) {
      const auto from = scene.kinematics.forward(q);
      course.travel_s.push_back(course.travel_s.back() +
                                std::max(distanceM(from, bMe) / scene.cell.limits.max_speed_mps,
                                         angleRad(from, bMe) / scene.cell.limits.max_angular_speed_radps));
      q = scene.kinematics.inverse(bMe, q).value_or(q);
      scene.take(bMe);
      scene.renew();
      course.after.push_back(scene.known());
    }
  }
  return course;
}

std::string viewsTo(const Course& course, double projection_px, double point_m) {
  for (std::size_t i = 0; i < course.after.size(); ++i) {
    if (course.after[i].projection_px <= projection_px && course.after[i].point_m <= point_m)
      return std::to_string(i);
  }
  return ">" + std::to_string(course.after.size() - 1);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App cli("Views to an accuracy, by planner");
  int seeds = 3, cameras = 1, most_views = kMostViews;
  double robot_mm = 0.1, corner_px = 0.2;
  std::string cell_file;
  std::vector<std::string> planners = {"information", "coverage", "random"};
  plan::InformativeOptions options;
  options.far_m = 1.5 * kRangeM;
  double tilt_deg = 45.0, roll_deg = 45.0;
  bool infrared = false;
  cli.add_option("--seeds", seeds, "Cells drawn")->capture_default_str();
  cli.add_option("--planners", planners, "Which of them")->check(CLI::IsMember(planners))->delimiter(',');
  cli.add_option("--cell", cell_file, "Another cell than the default one");
  cli.add_option("--cameras", cameras, "The first of the cell's")
      ->check(CLI::Range(1, 3))
      ->capture_default_str();
  cli.add_flag("--infrared", infrared, "Their infrared streams too");
  cli.add_option("--robot-mm", robot_mm, "Noise of the arm per axis and stop")->capture_default_str();
  cli.add_option("--corner-px", corner_px, "Noise of the corners per axis")->capture_default_str();
  cli.add_option("--views", most_views, "At most")->capture_default_str();
  cli.add_option("--candidates", options.candidates, "By information: board poses drawn at each step")
      ->capture_default_str();
  cli.add_option("--far", options.far_m, "They are at most so far away, m")->capture_default_str();
  cli.add_option("--tilt", tilt_deg, "and lean so far, degrees")->capture_default_str();
  cli.add_option("--roll", roll_deg, "and are turned so far about the optical axis")->capture_default_str();
  cli.add_option("--stop-time", options.stop_time_s, "A stop takes so long; much more than the way: fewest views count, s")
      ->capture_default_str();
  CLI11_PARSE(cli, argc, argv);
  options.max_tilt_rad = tilt_deg * M_PI / 180.0;
  options.max_roll_rad = roll_deg * M_PI / 180.0;
  const CellConfig cell = cell_file.empty() ? defaultCell() : loadCell(cell_file);

  std::printf(
      "%d camera(s)%s, robot %.2f mm, corners %.2f px; worst projection over the image px / worst point of the workspace mm\n",
      cameras, infrared ? " with infrared" : "", robot_mm, corner_px);
  std::printf("%4s %-12s %8s %8s %8s | after 5, 10, 15, 20, 30, 40, 60, 80 views\n", "seed", "planner",
              "0.5&0.5", "0.35px", "travel_s");
  for (int seed = 1; seed <= seeds; ++seed) {
    for (const std::string& planner : planners) {
      Scene scene(cell, static_cast<std::uint64_t>(seed), cameras, infrared, 1e-3 * robot_mm, corner_px);
      ByInformation information(scene, options);
      ByCoverage coverage;
      AtRandom random{std::mt19937_64(static_cast<std::uint64_t>(seed))};
      Chooser choose = std::ref(information);
      if (planner == "coverage") choose = std::ref(coverage);
      if (planner == "random") choose = std::ref(random);
      const Course course = run(scene, choose, most_views);
      const std::string to = viewsTo(course, 0.5, 0.0005);
      std::printf("%4d %-12s %8s %8s", seed, planner.c_str(), to.c_str(),
                  viewsTo(course, 0.35, INFINITY).c_str());
      std::printf(" %8.0f |", to[0] == '>' ? NAN : course.travel_s[std::stoul(to)]);
      for (const std::size_t n : {5, 10, 15, 20, 30, 40, 60, 80}) {
        if (n < course.after.size())
          std::printf(" %.2f/%.2f", course.after[n].projection_px, 1e3 * course.after[n].point_m);
      }
      if (information.plans > 0) {
        std::printf("  (%.0f ms CPU per planning step)", information.cpu_ms / information.plans);
      }
      std::printf("\n");
      std::fflush(stdout);
    }
  }
  return 0;
}
