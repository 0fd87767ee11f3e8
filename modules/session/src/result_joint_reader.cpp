// SPDX-License-Identifier: GPL-3.0-or-later
#include "result_parts.h"

namespace servocal::session {
namespace {

constexpr Range kCells{0, 1000};

/// `cells` numbers, none if that is 0.
std::vector<double> cellsOf(const ConfigReader& tree, const char* key, int cells) {
  const std::vector<double> values = tree.numbers(key, 0, kNumber);
  if (values.size() != static_cast<std::size_t>(cells)) {
    tree.fail(key, std::string("'") + key + "' must be a list of " + std::to_string(cells) + " numbers");
  }
  return values;
}

ProjectionMap readProjection(const ConfigReader& tree) {
  ProjectionMap map;
  map.cells_x = tree.integer("cells_x", kCells);
  map.cells_y = tree.integer("cells_y", kCells);
  map.sigma_px = cellsOf(tree, "sigma_px", map.cells_x * map.cells_y);
  map.worst_px = tree.number("worst_px", kNumber);
  map.rms_px = tree.number("rms_px", kNumber);
  tree.finish();
  return map;
}

WorkspaceMap readWorkspace(const ConfigReader& tree) {
  WorkspaceMap map;
  tree.has("cells_z");  // so that a missing cells_y is not taken for it misspelled
  map.cells_x = tree.integer("cells_x", kCells);
  map.cells_y = tree.integer("cells_y", kCells);
  map.cells_z = tree.integer("cells_z", kCells);
  map.sigma_m = cellsOf(tree, "sigma_m", map.cells_x * map.cells_y * map.cells_z);
  map.worst_m = tree.number("worst_m", kNumber);
  map.rms_m = tree.number("rms_m", kNumber);
  map.seen = tree.integer("seen", kCount);
  tree.finish();
  return map;
}

Stream readStream(const ConfigReader& tree, const char* key) {
  return tree.choice(key, {toString(Stream::kColor), toString(Stream::kInfrared)}) == 0 ? Stream::kColor
                                                                                        : Stream::kInfrared;
}

JointPair readPair(const ConfigReader& tree) {
  JointPair pair;
  tree.has("first_stream");  // so that a missing first is not taken for it misspelled; second likewise
  tree.has("second_stream");
  pair.first = tree.text("first");
  pair.first_stream = readStream(tree, "first_stream");
  pair.second = tree.text("second");
  pair.second_stream = readStream(tree, "second_stream");
  pair.first_by_second = readPose(tree.section("pose"), jointPairNames(pair)).pose;
  pair.covariance = tree.matrix("covariance", 6, 6, kNumber);
  pair.worst_m = tree.number("worst_m", kNumber);
  pair.rms_m = tree.number("rms_m", kNumber);
  pair.seen = tree.integer("seen", kCount);
  tree.finish();
  return pair;
}

JointCameraResult readCamera(const ConfigReader& tree, Mount mount) {
  JointCameraResult camera;
  camera.camera = tree.text("camera");
  camera.stream = readStream(tree, "stream");
  ReadModel model = readModel(tree, true);
  camera.model = std::move(model.camera);
  camera.sigma = std::move(model.sigma);
  // Asked for before it is demanded: a missing pose is not a misspelled pose_covariance.
  tree.has("pose_covariance");
  camera.pose = readPose(tree.section("pose"), cameraPoseNames(mount, camera.camera, camera.stream)).pose;
  camera.pose_covariance = tree.matrix("pose_covariance", 6, 6, kNumber);
  camera.rms_px = tree.number("rms_px", kNumber);
  camera.corner_scale = tree.number("corner_scale", kNumber);
  camera.views = tree.integer("views", kCount);
  camera.range_m = tree.number("range_m", kNumber);
  camera.at_infinity = readProjection(tree.section("at_infinity"));
  camera.at_range = readProjection(tree.section("at_range"));
  camera.workspace = readWorkspace(tree.section("workspace"));
  if (const auto halves = tree.optionalSection("halves")) {
    camera.halves = JointHalves{halves->number("rms_px", kNumber), halves->number("claimed_px", kNumber)};
    halves->finish();
  }
  tree.finish();
  return camera;
}

void readBoard(const ConfigReader& tree, Mount mount, JointResult& joint) {
  const ReadPose pose = readPose(tree.section("pose"), boardPoseNames(mount));
  joint.board_pose = pose.pose;
  joint.board_sigma = pose.sigma;
  tree.has("scale_y");  // so that a missing scale_x is not taken for it misspelled; bow likewise
  tree.has("bow_y_m");
  joint.board_scale_x = tree.number("scale_x", kNumber);
  joint.board_scale_y = tree.number("scale_y", kNumber);
  joint.board_bow_x_m = tree.number("bow_x_m", kNumber);
  joint.board_bow_y_m = tree.number("bow_y_m", kNumber);
  tree.finish();
}

void readRobot(const ConfigReader& tree, JointResult& joint) {
  for (const char* key : {"sigma_m", "sigma_deg", "declared_sigma_m", "declared_sigma_deg"}) tree.has(key);
  joint.robot_sigma_m = tree.number("sigma_m", kNumber);
  joint.robot_sigma_rad = radians(tree.number("sigma_deg", kNumber));
  joint.declared_sigma_m = tree.number("declared_sigma_m", kNumber);
  joint.declared_sigma_rad = radians(tree.number("declared_sigma_deg", kNumber));
  for (const ConfigReader& term : tree.sections("terms")) {
    const std::string name = term.text("name");
    joint.robot_terms.emplace_back(name, term.number("value", kNumber));
    term.finish();
  }
  tree.finish();
}

}  // namespace

JointResult readJoint(const ConfigReader& tree, Mount mount) {
  JointResult joint;
  if (tree.has("mount")) mount = tree.choice("mount", {"fixed", "flange"}) == 0 ? Mount::kFixed : Mount::kFlange;
  joint.mount = mount;
  joint.model = tree.text("model");
  for (const ConfigReader& camera : tree.sections("cameras"))
    joint.cameras.push_back(readCamera(camera, mount));
  if (tree.has("pairs")) {
    for (const ConfigReader& pair : tree.sections("pairs")) joint.pairs.push_back(readPair(pair));
  }
  readBoard(tree.section("board"), mount, joint);
  readRobot(tree.section("robot"), joint);
  joint.open = tree.texts("open");
  joint.faults = tree.texts("faults");
  joint.notes = tree.texts("notes");
  if (const auto section = tree.optionalSection("held_out")) {
    JointHeldOut held_out;
    held_out.views = section->integer("views", kCount);
    held_out.rms_px = section->number("rms_px", kNumber);
    held_out.rms_m = section->number("rms_m", kNumber);
    held_out.z = section->number("z", kNumber);
    section->finish();
    joint.held_out = held_out;
  }
  tree.finish();
  return joint;
}

}  // namespace servocal::session
