// SPDX-License-Identifier: GPL-3.0-or-later
// Calibrates a whole cell of several RGB-D cameras over seeds and prints every camera against the truth.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "trial.h"

namespace {

constexpr double kDegPerRad = 180.0 / M_PI;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? std::nan("") : values[values.size() / 2];
}

using servocal::test::CameraPairErrors;
using servocal::test::PairError;
using servocal::test::PlaneGap;

struct Mean {
  double gap_mm = 0.0, size_mm = 0.0, angle_deg = 0.0;
};

/// Over the places: signed distance, its size, and angle.
Mean meanOf(const std::vector<PlaneGap>& gaps) {
  Mean mean;
  const double n = static_cast<double>(gaps.size());
  for (const PlaneGap& gap : gaps) {
    mean.gap_mm += 1e3 * gap.distance_m / n;
    mean.size_mm += 1e3 * std::abs(gap.distance_m) / n;
    mean.angle_deg += gap.angle_rad * kDegPerRad / n;
  }
  return mean;
}

/// Columns of the table by camera, over all seeds.
struct Columns {
  std::map<std::string, std::vector<double>> values;
  void add(const std::string& column, double value) {
    if (std::isfinite(value)) values[column].push_back(value);
  }
};

/// Errors over claim of all streams and runs: root of the sum of chi-squares over that of the degrees of
/// freedom. Those of one run go together, so its size says more about the claims than its scatter would with
/// as many independent ones.
class PooledRatio {
 public:
  void add(const std::vector<servocal::test::JointErrors>& errors) {
    for (const servocal::test::JointErrors& stream : errors) {
      add("intrinsics", stream.lens, stream.lens_size);
      add("true base", stream.pose);
      add("as reported", stream.reported);
    }
  }
  void print(const std::string& what) const {
    if (groups_.empty()) return;
    std::printf("%s, pooled ratio of error to claim:", what.c_str());
    for (const auto& [name, group] : groups_)
      std::printf("  %s %.2f", name.c_str(), std::sqrt(group.chi_square / group.degrees));
    std::printf("\n");
  }

 private:
  struct Group {
    double chi_square = 0.0;
    int degrees = 0;
  };
  void add(const std::string& base, const servocal::test::PoseError& pose) {
    add(base + " positions", pose.position, 3);
    add(base + " rotations", pose.rotation, 3);
    add(base + " poses", pose.whole, 6);
  }
  void add(const std::string& name, double chi_square, int degrees) {
    if (!std::isfinite(chi_square)) return;
    groups_[name].chi_square += chi_square;
    groups_[name].degrees += degrees;
  }
  std::map<std::string, Group> groups_;
};

/// Every stream of a joint estimate.
void printJoint(const std::vector<servocal::test::JointErrors>& joint, const std::string& what,
                std::map<std::string, Columns>& columns) {
  for (const servocal::test::JointErrors& errors : joint) {
    const std::string name = errors.camera + " " + toString(errors.stream) + " " + what;
    const std::vector<std::pair<std::string, double>> row = {
        {"pose_mm", errors.pose.m * 1e3},
        {"pose_deg", errors.pose.rad * kDegPerRad},
        {"pose_z", errors.pose.z()},
        {"bound_mm", errors.pose_bound_m * 1e3},
        {"reported_mm", errors.reported.m * 1e3},
        {"reported_deg", errors.reported.rad * kDegPerRad},
        {"reported_z", errors.reported.z()},
        {"worst_error_px", errors.error_px},
        {"worst_claim_px", errors.claim_px},
        {"worst_bound_px", errors.bound_px}};
    std::printf("%42s | %-22s", "", name.c_str());
    for (const auto& [column, value] : row) {
      columns[name].add(column, value);
      std::printf(" %8.3f", value);
    }
    std::printf("\n");
  }
}

/// Two cameras against each other.
void printPair(const CameraPairErrors& pair, std::map<std::string, Columns>& columns) {
  const std::string name = pair.first + "-" + pair.second;
  const auto print = [&](const char* what, const PairError& error) {
    Columns& its = columns[name + " " + what];
    its.add("first_mm", 1e3 * error.first_m);
    its.add("second_mm", 1e3 * error.second_m);
    its.add("between_mm", 1e3 * error.between_m);
    its.add("pose_mm", 1e3 * error.pose_m);
    its.add("pose_deg", error.pose_rad * kDegPerRad);
    std::printf(
        "     %s %s: a point in the base off by %.3f mm, %.3f mm, the two apart %.3f mm; relative pose %.3f "
        "mm "
        "%.4f deg\n",
        name.c_str(), what, 1e3 * error.first_m, 1e3 * error.second_m, 1e3 * error.between_m,
        1e3 * error.pose_m, error.pose_rad * kDegPerRad);
  };
  print("staged", pair.staged);
  if (pair.joint) print("joint", *pair.joint);
  const auto printPlanes = [&](const char* what, const std::vector<PlaneGap>& gaps) {
    if (gaps.empty()) return;
    const Mean mean = meanOf(gaps);
    Columns& its = columns[name + " planes, " + what];
    its.add("gap_mm", mean.gap_mm);
    its.add("size_mm", mean.size_mm);
    its.add("angle_deg", mean.angle_deg);
    std::printf("     %s planes at %zu places, %s: signed distance mm", name.c_str(), gaps.size(), what);
    for (const PlaneGap& gap : gaps) std::printf(" %.2f", 1e3 * gap.distance_m);
    std::printf("; mean %.2f, mean size %.2f; mean angle %.3f deg; at least %d points\n", mean.gap_mm,
                mean.size_mm, mean.angle_deg,
                std::min_element(gaps.begin(), gaps.end(), [](const PlaneGap& a, const PlaneGap& b) {
                  return a.points < b.points;
                })->points);
  };
  printPlanes("as measured", pair.raw);
  printPlanes("corrected", pair.corrected);
  printPlanes("corrected, best estimate", pair.best);
}

}  // namespace

int main(int argc, char** argv) {
  using namespace servocal;
  CLI::App cli(
      "Calibrates a simulated cell of several cameras over seeds; prints every camera against the truth.",
      "cell_bench");
  int seeds = 10, first_seed = 1;
  std::string cell_file;
  bool again = false, without_arm = false;
  cli.add_option("--seeds", seeds, "How many")->capture_default_str();
  cli.add_option("--first", first_seed, "The first one")->capture_default_str();
  cli.add_option("--cell", cell_file, "Cell file; the default cell if not given");
  cli.add_flag("--again", again, "Of each seed a second run, with mount and tilt limits known from a first");
  cli.add_flag("--without-arm", without_arm, "Solve each session once more with the arm as it reports");
  CLI11_PARSE(cli, argc, argv);

  const CellConfig cell = cell_file.empty() ? defaultCell() : loadCell(cell_file);
  const auto folder =
      std::filesystem::temp_directory_path() / ("servocal-cell-bench-" + std::to_string(getpid()));
  std::printf(
      "seed goal  obs motion_s tilt_s lost cpu_s | camera  pose_mm pose_deg  cMi_mm cMi_deg  depth_mm before "
      " after"
      " beyond | held-out px    mm\n"
      "each stream of the joint estimate: pose_mm pose_deg z (1: the claim holds) bound_mm | the same in the "
      "base as the "
      "arm reports it: mm deg z | projection at range, worst place: error claim bound, px\n");
  std::map<std::string, Columns> by_camera;
  PooledRatio pooled, pooled_without_arm;
  std::vector<double> motion_s, tilt_s, cpu_s;
  int met = 0;
  for (int seed = first_seed; seed < first_seed + seeds; ++seed) {
    std::filesystem::remove_all(folder);
    test::Trial trial = test::runTrial(cell, static_cast<std::uint64_t>(seed), folder, {}, without_arm);
    if (again) {
      std::filesystem::remove_all(folder);
      procedure::CalibrateOptions options;
      options.known = trial.result;
      trial = test::runTrial(cell, static_cast<std::uint64_t>(seed), folder, options, without_arm);
    }
    met += trial.result.goal_met;
    motion_s.push_back(trial.result.motion_time_s);
    tilt_s.push_back(trial.result.tilt_time_s);
    cpu_s.push_back(trial.cpu_s);
    std::printf("%4d %4s %4d %8.1f %6.1f %4d %5.0f |\n", seed, trial.result.goal_met ? "yes" : "no",
                trial.result.observations, trial.result.motion_time_s, trial.result.tilt_time_s,
                trial.target_losses, trial.cpu_s);
    for (const test::CameraErrors& errors : trial.errors) {
      const auto camera =
          std::find_if(trial.result.cameras.begin(), trial.result.cameras.end(),
                       [&](const CameraResult& other) { return other.camera == errors.camera; });
      const double mm = 1e3, nothing = std::nan("");
      const std::vector<std::pair<std::string, double>> row = {
          {"pose_mm", errors.pose_m * mm},
          {"pose_deg", errors.pose_rad * kDegPerRad},
          {"cMi_mm", errors.infrared_m.value_or(nothing) * mm},
          {"cMi_deg", errors.infrared_rad.value_or(nothing) * kDegPerRad},
          {"depth_before_mm", errors.depth_before_m.value_or(nothing) * mm},
          {"depth_after_mm", errors.depth_after_m.value_or(nothing) * mm},
          {"depth_beyond_mm", errors.depth_beyond_m.value_or(nothing) * mm},
          {"held_out_px", camera->held_out ? camera->held_out->rms_px : nothing},
          {"held_out_mm", camera->held_out ? camera->held_out->rms_m * mm : nothing}};
      std::printf("%42s | %-6s", "", errors.camera.c_str());
      for (const auto& [column, value] : row) {
        by_camera[errors.camera].add(column, value);
        std::printf(" %8.3f", value);
      }
      std::printf("\n");
    }
    printJoint(trial.joint_errors, "joint", by_camera);
    pooled.add(trial.joint_errors);
    printJoint(trial.without_arm, "joint, arm as reported", by_camera);
    pooled_without_arm.add(trial.without_arm);
    for (const CameraPairErrors& pair : trial.pairs) printPair(pair, by_camera);
    if (const auto& joint = trial.result.joint) {
      std::printf(
          "     joint: robot %.3f mm %.4f deg per axis; held out %d views, %.3f px %.3f mm, z %.2f; %s\n",
          joint->robot_sigma_m * 1e3, joint->robot_sigma_rad * kDegPerRad,
          joint->held_out ? joint->held_out->views : 0, joint->held_out ? joint->held_out->rms_px : NAN,
          joint->held_out ? joint->held_out->rms_m * 1e3 : NAN, joint->held_out ? joint->held_out->z : NAN,
          joint->model.c_str());
      for (const std::string& fault : joint->faults) std::printf("     fault: %s\n", fault.c_str());
    } else {
      std::printf("     joint: none. %s\n", trial.result.joint_problem.c_str());
    }
    for (const CameraResult& camera : trial.result.cameras) {
      std::printf("     %s tilt limits:", camera.camera.c_str());
      for (const TiltLimit& limit : camera.tilt_limits) {
        std::printf(" %s%s %.0f (%s)", limit.stream == Stream::kInfrared ? "infrared " : "",
                    limit.direction.c_str(), limit.limit_rad * kDegPerRad, limit.ended_by.c_str());
      }
      std::printf("\n");
    }
    for (const std::string& missing : trial.result.missing)
      std::printf("     missing: %s\n", missing.c_str());
    std::fflush(stdout);
  }
  std::printf(
      "goal met %d of %d; robot time median %.0f s, worst %.0f s; tilt search median %.0f s; CPU median %.0f "
      "s\n",
      met, seeds, median(motion_s), *std::max_element(motion_s.begin(), motion_s.end()), median(tilt_s),
      median(cpu_s));
  for (const auto& [camera, columns] : by_camera) {
    std::printf("%s: median (worst)", camera.c_str());
    for (const auto& [column, values] : columns.values) {
      std::printf("  %s %.3f (%.3f)", column.c_str(), median(values),
                  *std::max_element(values.begin(), values.end()));
    }
    std::printf("\n");
  }
  pooled.print("joint estimate");
  pooled_without_arm.print("joint estimate, arm as reported");
  std::filesystem::remove_all(folder);
}
