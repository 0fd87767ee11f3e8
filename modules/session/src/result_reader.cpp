// SPDX-License-Identifier: GPL-3.0-or-later
#include "result_parts.h"
#include "servocal/core/error.h"
#include "servocal/session/session.h"

namespace servocal::session {
namespace {

bool demandedBoolean(const ConfigReader& tree, const char* key) {
  if (!tree.has(key)) tree.fail(key, std::string("missing key '") + key + "'");
  return tree.boolean(key, false);
}

std::vector<ViewResidual> readViews(const ConfigReader& tree) {
  static const std::vector<ViewCause> causes = {ViewCause::kNone,      ViewCause::kNoBoard,
                                                ViewCause::kCorners,   ViewCause::kBlurred,
                                                ViewCause::kRobotPose, ViewCause::kPoseFlip};
  std::vector<std::string> words;
  for (const ViewCause cause : causes) words.emplace_back(toString(cause));
  std::vector<ViewResidual> views;
  int used = 0;
  for (const ConfigReader& entry : tree.sections("views")) {
    ViewResidual view;
    view.observation_id = static_cast<std::int64_t>(entry.number("observation_id", {0, 9007199254740992.0}));
    view.name = entry.text("name");
    view.rms_px = entry.number("rms_px", kNumber);
    view.used = demandedBoolean(entry, "used");
    view.cause = causes[entry.choice("cause", words)];
    view.reason = entry.text("reason");
    entry.finish();
    used += view.used ? 1 : 0;
    views.push_back(view);
  }
  if (tree.integer("views_used", kCount) != used) {
    tree.fail("views_used",
              "'views_used' contradicts 'views', of which " + std::to_string(used) + " are used");
  }
  return views;
}

/// Leaves the tree open: the caller may know one key more ("with_outliers") and finishes it.
IntrinsicsResult readIntrinsicsTree(const ConfigReader& tree) {
  IntrinsicsResult intrinsics;
  const bool solved = tree.choice("source", {"given", "solved"}) == 1;
  ReadModel model = readModel(tree, solved);
  intrinsics.camera = std::move(model.camera);
  if (!solved) return intrinsics;
  intrinsics.sigma = std::move(model.sigma);
  intrinsics.rms_px = tree.number("rms_px", kNumber);
  intrinsics.corners = tree.integer("corners", kCount);
  if (tree.has("covariance")) {
    const int size = static_cast<int>(intrinsics.sigma.size());
    intrinsics.covariance = tree.matrix("covariance", size, size, kNumber);
  }
  intrinsics.views = readViews(tree);
  return intrinsics;
}

/// Leaves the tree open, as readIntrinsicsTree.
HandEyeSolution readHandEye(const ConfigReader& tree, const std::string& camera, Stream stream) {
  HandEyeSolution solution;
  solution.mount = tree.choice("mount", {"fixed", "flange"}) == 0 ? Mount::kFixed : Mount::kFlange;
  const ReadPose camera_pose =
      readPose(tree.section("camera_pose"), cameraPoseNames(solution.mount, camera, stream));
  solution.camera_pose = camera_pose.pose;
  solution.camera_sigma = camera_pose.sigma;
  const ReadPose board_pose = readPose(tree.section("board_pose"), boardPoseNames(solution.mount));
  solution.board_pose = board_pose.pose;
  solution.board_sigma = board_pose.sigma;
  solution.rms_px = tree.number("rms_px", kNumber);
  solution.robot_rms_m = tree.number("robot_correction_rms_m", kNumber);
  solution.robot_rms_rad = radians(tree.number("robot_correction_rms_deg", kNumber));
  solution.scatter_m = tree.number("scatter_m", kNumber);
  solution.scatter_rad = radians(tree.number("scatter_deg", kNumber));
  solution.symmetric_views = tree.integer("symmetric_views", kCount);
  solution.resolved_turns = tree.integer("resolved_turns", kCount);
  solution.resolved_flips = tree.integer("resolved_flips", kCount);
  solution.views = readViews(tree);
  return solution;
}

CoverageSummary readCoverage(const ConfigReader& tree) {
  CoverageSummary coverage;
  coverage.cells_x = tree.integer("cells_x", {0, 10000});
  coverage.cells_y = tree.integer("cells_y", {0, 10000});
  coverage.corners_to_fill = tree.integer("corners_to_fill", kCount);
  const auto cells = static_cast<std::size_t>(coverage.cells_x) * static_cast<std::size_t>(coverage.cells_y);
  for (const double corners : tree.numbers("corners_per_cell", cells, kCount)) {
    coverage.corners_per_cell.push_back(static_cast<int>(corners));
  }
  for (const std::string& word : tree.texts("unreachable")) {
    if (word != "true" && word != "false") tree.fail("unreachable", "'unreachable' must hold true or false");
    coverage.unreachable.push_back(word == "true");
  }
  if (coverage.unreachable.size() != cells) {
    tree.fail("unreachable", "'unreachable' must hold " + std::to_string(cells) + " values");
  }
  coverage.near_views = tree.integer("near_views", kCount);
  coverage.far_views = tree.integer("far_views", kCount);
  for (const ConfigReader& bin : tree.sections("tilt_bins")) {
    coverage.tilt_bins.emplace_back(bin.text("bin"), bin.integer("views", kCount));
    bin.finish();
  }
  if (tree.has("out_of_reach")) coverage.out_of_reach = tree.texts("out_of_reach");
  tree.finish();
  return coverage;
}

CameraPair readPair(const ConfigReader& tree, const std::string& first, const std::string& second,
                    const PoseNames& names) {
  CameraPair pair;
  pair.first = first;
  pair.second = second;
  pair.first_by_second = readPose(tree.section("pose"), names).pose;
  pair.covariance = tree.matrix("covariance", 6, 6, kNumber);
  pair.rms_px = tree.number("rms_px", kNumber);
  pair.views = readViews(tree);
  tree.finish();
  return pair;
}

DepthResult readDepth(const ConfigReader& tree, const std::optional<IntrinsicsResult>& infrared) {
  DepthResult depth;
  DepthModel& model = depth.model;
  const std::vector<DepthSensor> sensors = {DepthSensor::kStructuredLight, DepthSensor::kTimeOfFlight};
  model.sensor = sensors[tree.choice("sensor", {toString(sensors[0]), toString(sensors[1])})];
  if (tree.has("camera")) {
    const ConfigReader camera = tree.section("camera");
    model.camera = readModel(camera, false).camera;
    camera.finish();
  } else if (infrared) {
    model.camera = infrared->camera;
  } else {
    tree.fail("camera", "missing key 'camera': there is no 'infrared' beside the depth");
  }
  tree.has("nodes");  // so that a missing nodes_x is not taken for it misspelled
  model.offset = tree.number("offset", {});
  model.slope = tree.number("slope", {});
  model.nodes_x = tree.integer("nodes_x", {2, 1000});
  model.nodes_y = tree.integer("nodes_y", {2, 1000});
  model.nodes = vectorOf(tree, "nodes", static_cast<std::size_t>(model.nodes_x * model.nodes_y));
  if (tree.has("wiggle")) {
    tree.has("wiggle_to_m");  // so that a missing wiggle_from_m is not taken for it misspelled
    model.wiggle = vectorOf(tree, "wiggle");
    model.wiggle_from_m = tree.number("wiggle_from_m", {});
    model.wiggle_to_m = tree.number("wiggle_to_m", {});
    if (model.wiggle.size() < 2 || !(model.wiggle_to_m > model.wiggle_from_m))
      tree.fail("wiggle", "'wiggle' must hold at least two numbers, from 'wiggle_from_m' to a larger 'wiggle_to_m'");
  }
  model.near_m = tree.number("near_m", kNumber);
  model.far_m = tree.number("far_m", kNumber);
  depth.rms_before_m = tree.number("rms_before_m", kNumber);
  depth.rms_after_m = tree.number("rms_after_m", kNumber);
  depth.sigma_m = vectorOf(tree, "sigma_m");
  depth.sigma_at_m = vectorOf(tree, "sigma_at_m");
  if (depth.sigma_m.size() != depth.sigma_at_m.size()) {
    tree.fail("sigma_at_m", "'sigma_m' and 'sigma_at_m' must hold equally many numbers");
  }
  depth.views = tree.integer("views", kCount);
  depth.patches = tree.integer("patches", kCount);
  depth.notes = tree.texts("notes");
  tree.finish();
  return depth;
}

std::vector<TiltLimit> readTiltLimits(const ConfigReader& tree) {
  const std::vector<Stream> streams = {Stream::kColor, Stream::kInfrared, Stream::kDepth};
  std::vector<TiltLimit> limits;
  for (const ConfigReader& entry : tree.sections("tilt_limits")) {
    TiltLimit limit;
    limit.stream = streams[entry.choice("stream", {"color", "infrared", "depth"})];
    limit.direction = entry.text("direction");
    limit.limit_rad = radians(entry.number("limit_deg", kNumber));
    limit.ended_by = entry.text("ended_by");
    entry.finish();
    limits.push_back(limit);
  }
  return limits;
}

void readInfrared(const ConfigReader& tree, CameraResult& camera) {
  if (const auto section = tree.optionalSection("infrared")) {
    camera.infrared = readIntrinsicsTree(*section);
    section->finish();
  }
  if (const auto section = tree.optionalSection("infrared_hand_eye")) {
    camera.infrared_hand_eye = readHandEye(*section, camera.camera, Stream::kInfrared);
    section->finish();
  }
  if (const auto section = tree.optionalSection("color_infrared")) {
    camera.color_infrared =
        readPair(*section, camera.camera, camera.camera, colorInfraredNames(camera.camera));
  }
  if (const auto section = tree.optionalSection("depth")) camera.depth = readDepth(*section, camera.infrared);
  if (const auto section = tree.optionalSection("infrared_coverage"))
    camera.infrared_coverage = readCoverage(*section);
  camera.combined_views = tree.integer("combined_views", kCount, 0);
}

CameraResult readCamera(const ConfigReader& tree) {
  CameraResult camera;
  camera.camera = tree.text("camera");
  const ConfigReader intrinsics = tree.section("intrinsics");
  camera.intrinsics = readIntrinsicsTree(intrinsics);
  if (const auto section = intrinsics.optionalSection("with_outliers")) {
    camera.intrinsics_with_outliers = readIntrinsicsTree(*section);
    section->finish();
  }
  intrinsics.finish();
  if (const auto hand_eye = tree.optionalSection("hand_eye")) {
    camera.hand_eye = readHandEye(*hand_eye, camera.camera, Stream::kColor);
    if (const auto section = hand_eye->optionalSection("with_outliers")) {
      camera.hand_eye_with_outliers = readHandEye(*section, camera.camera, Stream::kColor);
      section->finish();
    }
    hand_eye->finish();
  }
  if (const auto section = tree.optionalSection("board_scale")) {
    camera.board_scale = BoardScale{section->number("scale", kNumber), section->number("sigma", kNumber)};
    section->finish();
  }
  if (tree.has("notes")) camera.notes = tree.texts("notes");
  if (const auto section = tree.optionalSection("coverage")) camera.coverage = readCoverage(*section);
  if (tree.has("tilt_limits")) camera.tilt_limits = readTiltLimits(tree);
  readInfrared(tree, camera);
  if (const auto section = tree.optionalSection("affine_baseline")) {
    AffineEyeToHand affine;
    affine.bAc = section->matrix("matrix", 3, 4, kNumber);
    affine.rms_m = section->number("rms_m", kNumber);
    affine.inliers = section->integer("inliers", kCount);
    affine.points = section->integer("points", kCount);
    section->finish();
    camera.affine_baseline = affine;
  }
  if (tree.has("time_offset_s")) {
    camera.time_offset_s = tree.number("time_offset_s", kNumber);
    camera.time_offset_sigma_s = tree.number("time_offset_sigma_s", kNumber);
  }
  if (const auto section = tree.optionalSection("held_out")) {
    HeldOut held_out;
    held_out.views = section->integer("views", kCount);
    held_out.rms_px = section->number("rms_px", kNumber);
    held_out.rms_m = section->number("rms_m", kNumber);
    section->finish();
    camera.held_out = held_out;
  }
  tree.finish();
  return camera;
}

/// "cam1_color" -> "cam1"
std::string cameraOf(const ConfigReader& pose, const char* key) {
  const std::string frame = pose.text(key), ending = "_color";
  if (frame.size() <= ending.size() ||
      frame.compare(frame.size() - ending.size(), ending.size(), ending) != 0) {
    pose.fail(key, std::string("'") + key + "' is '" + frame + "', not the color frame of a camera");
  }
  return frame.substr(0, frame.size() - ending.size());
}

CalibrationResult readResult(const ConfigReader& tree) {
  CalibrationResult result;
  const int version = tree.integer("schema_version", {});
  if (version < kOldestReadSchemaVersion || version > kResultSchemaVersion) {
    tree.fail("schema_version", "'schema_version' is " + std::to_string(version) + ", this program reads " +
                                    std::to_string(kOldestReadSchemaVersion) + " to " +
                                    std::to_string(kResultSchemaVersion) +
                                    "; solve the session again with servocal-solve");
  }
  result.provenance = tree.text("provenance");
  result.goal_met = demandedBoolean(tree, "goal_met");
  result.missing = tree.texts("missing");
  result.board = readBoard(tree.section("board"));
  result.observations = tree.integer("observations", kCount);
  result.motion_time_s = tree.number("motion_time_s", kNumber);
  result.tilt_time_s = tree.number("tilt_time_s", kNumber);
  for (const ConfigReader& camera : tree.sections("cameras")) result.cameras.push_back(readCamera(camera));
  if (tree.has("camera_pairs")) {
    for (const ConfigReader& pair : tree.sections("camera_pairs")) {
      const ConfigReader pose = pair.section("pose");
      const std::string first = cameraOf(pose, "parent_frame"), second = cameraOf(pose, "child_frame");
      result.camera_pairs.push_back(readPair(pair, first, second, cameraPairNames(first, second)));
    }
  }
  if (const auto section = tree.optionalSection("joint")) result.joint = readJoint(*section, mountOfHandEye(result));
  result.joint_problem = tree.text("joint_problem", "");
  tree.finish();
  return result;
}

}  // namespace

CalibrationResult loadResult(const std::filesystem::path& file) {
  try {
    return readResult(ConfigReader::fromFile(file));
  } catch (const Error& error) {
    throw Error(ErrorKind::kBadData, std::string("result file ") + error.what());
  }
}

}  // namespace servocal::session
