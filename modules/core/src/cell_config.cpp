// SPDX-License-Identifier: GPL-3.0-or-later
#include "servocal/core/cell_config.h"

#include <algorithm>
#include <stdexcept>

#include "config_text.h"
#include "default_cell.h"
#include "servocal/core/config_reader.h"
#include "simulation_config.h"

namespace servocal {
namespace {

constexpr double kRadPerDeg = 3.14159265358979323846 / 180.0;
constexpr Range kAnywhere{-100.0, 100.0};  ///< Positions in the cell, m.

Box readBox(const ConfigReader& section, const std::string& name) {
  Box box;
  box.name = name;
  box.min_m = section.vector3("min_m", kAnywhere);
  box.max_m = section.vector3("max_m", kAnywhere);
  section.finish();
  if ((box.min_m.array() >= box.max_m.array()).any()) {
    section.fail("min_m", "box '" + name + "': every number of 'min_m' must be below that of 'max_m'");
  }
  return box;
}

UrConfig readUr(const ConfigReader& section) {
  constexpr Range kPort{1, 65535};
  UrConfig ur;
  ur.host = section.text("host");
  if (ur.host.empty()) section.fail("host", "'host' must name the robot's controller");
  ur.serial = section.text("serial");
  if (ur.serial.empty()) section.fail("serial", "'serial' must be the robot's serial number, from its label");
  ur.rtde_port = section.integer("rtde_port", kPort, ur.rtde_port);
  ur.dashboard_port = section.integer("dashboard_port", kPort, ur.dashboard_port);
  ur.program_port = section.integer("program_port", kPort, ur.program_port);
  return ur;
}

SearchSweep readSearch(const ConfigReader& section, Eigen::Index joints) {
  SearchSweep search;
  constexpr Range kTurn{-360.0, 360.0};
  const std::vector<double> others_deg =
      section.numbers("posture_deg", static_cast<std::size_t>(joints - 1), kTurn);
  const std::vector<double> sweep_deg = section.numbers("first_joint_deg", 2, kTurn);
  search.from_rad = sweep_deg[0] * kRadPerDeg;
  search.to_rad = sweep_deg[1] * kRadPerDeg;
  search.posture_q.resize(joints);
  search.posture_q[0] = search.from_rad;
  for (Eigen::Index i = 1; i < joints; ++i) {
    search.posture_q[i] = others_deg[static_cast<std::size_t>(i - 1)] * kRadPerDeg;
  }
  section.finish();
  return search;
}

ArmConfig readArm(const ConfigReader& section, const std::filesystem::path& folder) {
  ArmConfig arm;
  arm.backend = static_cast<ArmBackend>(section.choice("backend", {"sim", "ur"}));
  if (arm.backend == ArmBackend::kUr) arm.ur = readUr(section);
  arm.urdf = section.text("urdf", arm.urdf);
  arm.base_link = section.text("base_link", arm.base_link);
  arm.flange_link = section.text("flange_link", arm.flange_link);
  const std::size_t joints = arm.urdf == "ur5" ? 6 : 0;  // 0: any; the URDF's chain decides later.
  const std::vector<double> start_q_deg = section.numbers("start_q_deg", joints, {-360.0, 360.0});
  if (start_q_deg.empty()) section.fail("start_q_deg", "'start_q_deg' must name every joint of the arm");
  arm.start_q =
      Eigen::Map<const Eigen::VectorXd>(start_q_deg.data(), static_cast<Eigen::Index>(start_q_deg.size())) *
      kRadPerDeg;
  if (const auto search = section.optionalSection("search")) arm.search = readSearch(*search, arm.start_q.size());
  arm.accuracy_m = section.number("accuracy_m", {1e-6, 0.05}, arm.accuracy_m);
  arm.accuracy_rad = section.number("accuracy_deg", {1e-5, 5.0}, arm.accuracy_rad / kRadPerDeg) * kRadPerDeg;
  section.finish();
  if (arm.urdf != "ur5") arm.urdf = (folder / arm.urdf).string();
  return arm;
}

MotionLimits readLimits(const ConfigReader& section) {
  MotionLimits limits;
  limits.max_speed_mps = section.number("max_speed_mps", {0.001, 1.0}, limits.max_speed_mps);
  limits.max_angular_speed_radps =
      section.number("max_angular_speed_radps", {0.001, 3.0}, limits.max_angular_speed_radps);
  limits.max_acceleration_mps2 =
      section.number("max_acceleration_mps2", {0.01, 10.0}, limits.max_acceleration_mps2);
  limits.max_angular_acceleration_radps2 =
      section.number("max_angular_acceleration_radps2", {0.01, 20.0}, limits.max_angular_acceleration_radps2);
  limits.max_joint_speed_radps =
      section.number("max_joint_speed_radps", {0.001, 3.2}, limits.max_joint_speed_radps);
  limits.joint_margin_rad =
      section.number("joint_margin_deg", {0.0, 45.0}, limits.joint_margin_rad / kRadPerDeg) * kRadPerDeg;
  limits.workspace = readBox(section.section("workspace"), "workspace");
  if (section.has("keep_out")) {
    for (const ConfigReader& box : section.sections("keep_out")) {
      limits.keep_out.push_back(readBox(box, box.text("name")));
    }
  }
  section.finish();
  return limits;
}

InfraredConfig readInfrared(const ConfigReader& section) {
  InfraredConfig infrared;
  infrared.width_px = section.integer("width_px", {64, 20000});
  infrared.height_px = section.integer("height_px", {64, 20000});
  infrared.horizontal_fov_rad = section.number("horizontal_fov_deg", {5.0, 170.0}) * kRadPerDeg;
  if (section.has("depth")) {
    infrared.depth = static_cast<DepthSensor>(section.choice("depth", {"structured_light", "time_of_flight"}));
  }
  infrared.excludes_color = section.boolean("excludes_color", infrared.excludes_color);
  section.finish();
  return infrared;
}

ImageRegion readRegion(const ConfigReader& section, const CameraConfig& camera) {
  const std::vector<double> numbers = section.numbers("region_px", 4, {0, 20000});
  const ImageRegion region{static_cast<int>(numbers[0]), static_cast<int>(numbers[1]), static_cast<int>(numbers[2]),
                           static_cast<int>(numbers[3])};
  if (region.width_px < 1 || region.height_px < 1 || region.x_px + region.width_px > camera.width_px ||
      region.y_px + region.height_px > camera.height_px) {
    section.fail("region_px", "'region_px' (x, y, width, height) must lie in the image of " +
                                  std::to_string(camera.width_px) + " x " + std::to_string(camera.height_px));
  }
  return region;
}

CameraConfig readCamera(const ConfigReader& section) {
  CameraConfig camera;
  camera.name = section.text("name");
  if (camera.name.empty()) section.fail("name", "a camera needs a name");
  camera.backend =
      static_cast<CameraBackend>(section.choice("backend", {"sim", "openni2", "freenect", "v4l2"}));
  if (camera.backend != CameraBackend::kSim) camera.device = section.text("device", "");
  if (camera.backend == CameraBackend::kV4l2 && section.has("infrared")) {
    section.fail("infrared", "a camera of the backend 'v4l2' has a color image alone");
  }
  camera.mount = static_cast<Mount>(section.choice("mount", {"fixed", "flange"}, 0));
  camera.width_px = section.integer("width_px", {64, 20000});
  camera.height_px = section.integer("height_px", {64, 20000});
  camera.horizontal_fov_rad = section.number("horizontal_fov_deg", {5.0, 170.0}) * kRadPerDeg;
  camera.latency_s = section.number("latency_s", {0.0, 2.0}, camera.latency_s);
  if (const auto infrared = section.optionalSection("infrared")) camera.infrared = readInfrared(*infrared);
  if (section.has("region_px")) camera.region = readRegion(section, camera);
  section.finish();
  return camera;
}

CoverageConfig readCoverage(const ConfigReader& section) {
  CoverageConfig coverage;
  coverage.cells_x = section.integer("cells_x", {1, 64}, coverage.cells_x);
  coverage.cells_y = section.integer("cells_y", {1, 64}, coverage.cells_y);
  coverage.infrared_cells_x = section.integer("infrared_cells_x", {1, 64}, coverage.infrared_cells_x);
  coverage.infrared_cells_y = section.integer("infrared_cells_y", {1, 64}, coverage.infrared_cells_y);
  coverage.corners_per_cell = section.integer("corners_per_cell", {1, 1000}, coverage.corners_per_cell);
  coverage.distance_ratio = section.number("distance_ratio", {1.05, 5.0}, coverage.distance_ratio);
  coverage.near_distance_m = section.number("near_distance_m", {0.05, 10.0}, coverage.near_distance_m);
  coverage.max_views = section.integer("max_views", {3, 1000}, coverage.max_views);
  coverage.revisit_views = section.integer("revisit_views", {0, 1000}, coverage.revisit_views);
  coverage.check_views = section.integer("check_views", {0, 1000}, coverage.check_views);
  section.finish();
  return coverage;
}

PlannerConfig readPlanner(const ConfigReader& section) {
  PlannerConfig planner;
  planner.choose_by = section.choice("choose_by", {"coverage", "information"}, 0) == 0 ? Planner::kCoverage
                                                                                     : Planner::kInformation;
  planner.projection_goal_px = section.number("projection_goal_px", {0.01, 100.0}, planner.projection_goal_px);
  planner.point_goal_m = section.number("point_goal_m", {1e-5, 0.1}, planner.point_goal_m);
  planner.max_views = section.integer("max_views", {3, 10000}, planner.max_views);
  planner.max_time_s = section.number("max_time_s", {1.0, 1e5}, planner.max_time_s);
  section.finish();
  return planner;
}

/// What a simulated arm carries no real camera sees: whatever driver reads a camera, its images are
/// simulated.
void demandSimulatedCameras(const ConfigReader& reader, const CellConfig& cell) {
  for (const CameraConfig& camera : cell.cameras) {
    const auto& simulated = cell.simulation->cameras;
    if (std::none_of(simulated.begin(), simulated.end(),
                     [&](const SimulatedCameraConfig& other) { return other.name == camera.name; })) {
      reader.fail("cameras", "camera '" + camera.name +
                                 "' is missing in 'simulation.cameras': the arm is simulated, so no "
                                 "real camera can see what it carries");
    }
  }
}

CellConfig readCell(const std::string& text, const std::string& origin, const std::filesystem::path& file) {
  const ConfigReader reader = ConfigReader::fromText(text, origin);
  CellConfig cell;
  cell.file = file;
  cell.text = text;
  cell.name = reader.text("name");
  cell.board = readBoard(reader.section("board"));
  cell.arm = readArm(reader.section("arm"), file.parent_path());
  cell.limits = readLimits(reader.section("limits"));
  for (const ConfigReader& section : reader.sections("cameras")) {
    const CameraConfig camera = readCamera(section);
    for (const CameraConfig& other : cell.cameras) {
      if (other.name == camera.name) {
        section.fail("name", "camera '" + camera.name + "' is there twice; names must differ");
      }
    }
    cell.cameras.push_back(camera);
  }
  if (cell.cameras.empty()) reader.fail("cameras", "'cameras' must list at least one camera");
  if (const auto section = reader.optionalSection("coverage")) cell.coverage = readCoverage(*section);
  if (const auto section = reader.optionalSection("planner")) cell.planner = readPlanner(*section);
  if (const auto section = reader.optionalSection("simulation")) {
    cell.simulation = readSimulation(*section, cell.cameras);
  }
  reader.finish();
  const bool simulated =
      cell.arm.backend == ArmBackend::kSim ||
      std::any_of(cell.cameras.begin(), cell.cameras.end(),
                  [](const CameraConfig& camera) { return camera.backend == CameraBackend::kSim; });
  if (simulated && !cell.simulation) {
    reader.fail("simulation", "missing key 'simulation': the backend 'sim' needs it");
  }
  if (cell.arm.backend == ArmBackend::kSim) demandSimulatedCameras(reader, cell);
  return cell;
}

}  // namespace

CameraModel nominalModel(const CameraConfig& camera, Stream stream) {
  if (stream == Stream::kColor) {
    return CameraModel::fromFieldOfView(camera.width_px, camera.height_px, camera.horizontal_fov_rad);
  }
  if (!camera.infrared) {
    throw std::invalid_argument("camera '" + camera.name + "' has no " + toString(stream) + " stream");
  }
  const InfraredConfig& infrared = *camera.infrared;
  return CameraModel::fromFieldOfView(infrared.width_px, infrared.height_px, infrared.horizontal_fov_rad);
}

CellConfig loadCell(const std::filesystem::path& file) {
  return readCell(readConfigText(file), file.string(), file);
}

CellConfig parseCell(const std::string& text, const std::string& origin) { return readCell(text, origin, {}); }

CellConfig defaultCell() { return readCell(kDefaultCellText, "default_cell.yaml (built in)", {}); }

}  // namespace servocal
