// SPDX-License-Identifier: GPL-3.0-or-later
// A finished session of a cell with several RGB-D cameras, as a run would leave it, from a known truth: for
// what reads sessions and results. Nothing is calibrated; the result is the truth with plausible
// uncertainties.
#pragma once

#include <string>
#include <vector>

#include "calib_scene.h"
#include "random_result.h"
#include "servocal/core/result.h"
#include "servocal/session/session.h"

namespace servocal::test {

class RecordedCell {
 public:
  RecordedCell(int cameras, int stops) : random_(23) {
    for (int i = 0; i < cameras; ++i)
      addCamera("cam" + std::to_string(i + 1), 2.4 * i - 1.2 * (cameras - 1), i == 1);
    for (int i = 0; i < stops; ++i) addStop(cameras, i, stops);
    finish();
  }

  CalibrationResult result;
  std::vector<Observation> observations;
  std::vector<Attempt> attempts;

  /// As servocal-calibrate leaves it: session and result.yaml.
  void save(const std::filesystem::path& folder) const {
    session::Session recorded = session::Session::create(folder, cellText(), result.board, 1);
    for (const Observation& observation : observations) {
      (void)recorded.add(observation, {});
    }
    for (const Attempt& attempt : attempts) (void)recorded.add(attempt);
    session::saveResult(folder / "result.yaml", result);
  }

  static std::string cellText() { return defaultCell().text; }

 private:
  static constexpr double kCornerPx = 0.12, kStopS = 3.0;

  void addCamera(const std::string& name, double yaw_rad, bool structured_light) {
    CameraResult camera;
    camera.camera = name;
    camera.intrinsics.camera = hdCamera();
    camera.infrared.emplace();
    CameraModel& infrared = camera.infrared->camera;
    infrared = CameraModel::fromFieldOfView(512, 424, 1.22);
    infrared.parameters.tail<5>() << 0.09, -0.26, 0.0002, -0.0001, 0.09;
    camera.hand_eye.emplace();
    // Around the board's usual place (0.45, 0, 0.4), 0.6 m from it, looking at it.
    const Eigen::Vector3d middle(0.45, 0.0, 0.4),
        offset(0.6 * std::cos(0.4 * yaw_rad), 0.6 * std::sin(0.4 * yaw_rad), 0.1);
    Eigen::Matrix3d looking;
    looking.col(2) = -offset.normalized();
    looking.col(0) = looking.col(2).cross(Eigen::Vector3d::UnitZ()).normalized();
    looking.col(1) = looking.col(2).cross(looking.col(0));
    camera.hand_eye->camera_pose = Pose<Base, Color>(looking, middle + offset).isometry();
    camera.hand_eye->board_pose =
        Pose<EndEffector, Board>::fromRotationVector({0.1, 3.0, 0.1}, {0.01, 0.02, 0.06}).isometry();
    camera.hand_eye->camera_sigma << 3e-4, 4e-4, 2e-4, 2e-4, 2e-4, 3e-4;
    camera.hand_eye->board_sigma << 1e-4, 1e-4, 1e-4, 2e-4, 2e-4, 2e-4;
    CameraPair beside;
    beside.first = beside.second = name;
    beside.first_by_second =
        Pose<Color, Infrared>::fromRotationVector({0.01, -0.02, 0.003}, {0.052, 0.001, -0.002}).isometry();
    beside.covariance = Eigen::Matrix<double, 6, 6>::Identity() * 1e-8;
    beside.rms_px = 0.14;
    camera.color_infrared = beside;
    DepthResult depth;
    depth.model.sensor = structured_light ? DepthSensor::kStructuredLight : DepthSensor::kTimeOfFlight;
    depth.model.camera = infrared;
    depth.model.offset = structured_light ? 0.01 : -0.015;
    depth.model.slope = 1.003;
    depth.model.nodes_x = 4;
    depth.model.nodes_y = 3;
    depth.model.nodes = 0.004 * Eigen::VectorXd::LinSpaced(12, -1.0, 1.0);
    depth.model.near_m = 0.4;
    depth.model.far_m = 0.9;
    depth.rms_before_m = 0.013;
    depth.rms_after_m = 0.0015;
    depth.sigma_at_m = Eigen::Vector4d(0.4, 0.65, 0.9, 1.5);
    depth.sigma_m = Eigen::Vector4d(6e-4, 4e-4, 7e-4, 2e-3);
    depth.notes = {"the lattice has 4 x 3 nodes: the patches do not carry more"};
    camera.depth = depth;
    for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
      for (const char* direction : {"roll+", "roll-", "pitch+", "pitch-", "yaw+", "yaw-"}) {
        const bool roll = direction[0] == 'r';
        camera.tilt_limits.push_back(
            {direction, roll ? 0.785 : 0.7 + 0.1 * normal_(random_), roll ? "cap" : "detection", stream});
      }
    }
    camera.board_scale = BoardScale{1.0002, 1e-4};
    camera.time_offset_s = 0.002;
    camera.time_offset_sigma_s = 0.001;
    result.cameras.push_back(camera);
  }

  /// The raw depth that the model corrects to `depth_m`.
  static double rawDepth(const DepthModel& model, const Eigen::Vector2d& pixel, double depth_m) {
    double raw_m = depth_m;
    for (int i = 0; i < 20; ++i) raw_m += depth_m - model.correct(pixel, raw_m).value_or(depth_m);
    return raw_m;
  }

  StreamObservation see(const CameraResult& camera, Stream stream, const Pose<Base, Board>& bMo,
                        Instant stamp) {
    const bool color = stream == Stream::kColor;
    const CameraModel& lens = color ? camera.intrinsics.camera : camera.infrared->camera;
    Eigen::Isometry3d bMc = camera.hand_eye->camera_pose;
    if (!color) bMc = bMc * camera.color_infrared->first_by_second;
    const Pose<Color, Board> cMo(bMc.inverse() * bMo.isometry());
    StreamObservation view;
    view.camera = camera.camera;
    view.stream = stream;
    view.stamp = stamp;
    view.width_px = lens.width_px;
    view.height_px = lens.height_px;
    view.detection = detect(result.board, lens, cMo, kCornerPx, random_);
    if (color || view.detection.corners.empty()) return view;
    BoardDepth depth;
    depth.frames = 5;
    for (const Corner& corner : view.detection.corners) {
      const double depth_m = (cMo * result.board.corner(corner.id)).z() + 0.001 * normal_(random_);
      depth.patches.push_back(
          {corner.pixel, rawDepth(camera.depth->model, corner.pixel, depth_m), 0.001, 200});
    }
    view.depth = depth;
    return view;
  }

  void addStop(int cameras, int index, int stops) {
    // In front of one camera after the other, at two distances; the others watch.
    const CameraResult& turn = result.cameras[static_cast<std::size_t>(index * cameras / stops)];
    std::uniform_real_distribution<double> uniform(-1.0, 1.0);
    const Eigen::Vector3d tilt(0.6 * uniform(random_), 0.6 * uniform(random_), 0.5 * uniform(random_));
    const double depth_m = index % 2 == 0 ? 0.45 : 0.62;
    const auto cMo = Pose<Color, Board>::fromRotationVector(
        tilt, {0.6 * depth_m * uniform(random_), 0.33 * depth_m * uniform(random_), depth_m});
    const Pose<Base, Board> bMo(turn.hand_eye->camera_pose * cMo.isometry());
    const auto stamp = Instant(fromSeconds(kStopS * (index + 1)));
    Observation observation;
    observation.id = static_cast<std::int64_t>(observations.size()) + 1;
    observation.stage = index < stops / 10 ? "bootstrap" : index < stops / 5 ? "tilt" : "cover";
    RobotState robot;
    robot.stamp = stamp;
    robot.q = Eigen::VectorXd::Zero(6);
    const Pose<Base, EndEffector> bMe(bMo.isometry() * turn.hand_eye->board_pose.inverse());
    robot.bMe = disturbed(bMe, random_, 0.0003, 0.0005);
    observation.robot = robot;
    for (const CameraResult& camera : result.cameras) {
      for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
        StreamObservation view = see(camera, stream, bMo, stamp);
        if (view.detection.corners.size() >= 12 &&
            (bMo.rotation().col(2).dot(camera.hand_eye->camera_pose.linear().col(2)) > 0.3)) {
          observation.views.push_back(view);
        }
      }
    }
    observations.push_back(observation);
    Attempt attempt;
    attempt.stage = observation.stage;
    attempt.camera = turn.camera;
    attempt.start = stamp - fromSeconds(kStopS - 0.4);
    attempt.end = stamp;
    attempt.cdMo = cMo;
    attempt.status = index % 17 == 16 ? DriveStatus::kUnreachable : DriveStatus::kReached;
    attempt.reason =
        attempt.status == DriveStatus::kReached ? "" : "the arm has no <joint> angles for this view";
    if (attempt.status == DriveStatus::kReached) attempt.observation_id = observation.id;
    attempts.push_back(attempt);
  }

  std::vector<ViewResidual> viewsOf(const std::string& camera, Stream stream) {
    std::vector<ViewResidual> views;
    for (const Observation& observation : observations) {
      for (const StreamObservation& view : observation.views) {
        if (view.camera != camera || view.stream != stream) continue;
        ViewResidual residual;
        residual.observation_id = observation.id;
        residual.name = observation.stage;
        residual.rms_px = kCornerPx * std::sqrt(2.0) * (1 + 0.1 * normal_(random_));
        if (observation.id % 23 == 0) {
          residual.used = false;
          residual.rms_px *= 5;
          residual.cause = ViewCause::kBlurred;
          residual.reason = "its corners are far less sharp than those of the other views";
        }
        views.push_back(residual);
      }
    }
    return views;
  }

  void finish() {
    for (CameraResult& camera : result.cameras) {
      for (const Stream stream : {Stream::kColor, Stream::kInfrared}) {
        IntrinsicsResult& lens = stream == Stream::kColor ? camera.intrinsics : *camera.infrared;
        lens.sigma.resize(9);
        lens.sigma << 0.3, 0.3, 0.4, 0.4, 0.001, 0.004, 5e-5, 5e-5, 0.005;
        lens.covariance = lens.sigma.array().square().matrix().asDiagonal();
        lens.views = viewsOf(camera.camera, stream);
        lens.corners = 24 * static_cast<int>(lens.views.size());
        lens.rms_px = kCornerPx * std::sqrt(2.0);
        (stream == Stream::kColor ? camera.coverage : camera.infrared_coverage) =
            coverageOf(camera.camera, stream, lens.camera);
      }
      camera.hand_eye->views = viewsOf(camera.camera, Stream::kColor);
      camera.hand_eye->rms_px = 0.19;
      camera.hand_eye->robot_rms_m = 0.0003;
      camera.hand_eye->robot_rms_rad = 0.0005;
      camera.hand_eye->scatter_m = 0.0006;
      camera.hand_eye->scatter_rad = 0.0008;
      camera.color_infrared->views = viewsOf(camera.camera, Stream::kInfrared);
      camera.depth->views = static_cast<int>(camera.color_infrared->views.size());
      camera.depth->patches = 24 * camera.depth->views;
    }
    result.goal_met = true;
    result.observations = static_cast<int>(observations.size());
    result.motion_time_s = kStopS * static_cast<double>(observations.size());
    result.tilt_time_s = 0.1 * result.motion_time_s;
    result.provenance = "a recorded cell made for tests";
  }

  CoverageSummary coverageOf(const std::string& camera, Stream stream, const CameraModel& lens) const {
    CoverageSummary coverage;
    coverage.cells_x = 8;
    coverage.cells_y = 5;
    coverage.corners_to_fill = 12;
    coverage.corners_per_cell.assign(40, 0);
    coverage.unreachable.assign(40, false);
    for (const Observation& observation : observations) {
      for (const StreamObservation& view : observation.views) {
        if (view.camera != camera || view.stream != stream) continue;
        for (const Corner& corner : view.detection.corners) {
          const int x = std::clamp(static_cast<int>(corner.pixel.x() / lens.width_px * 8), 0, 7);
          const int y = std::clamp(static_cast<int>(corner.pixel.y() / lens.height_px * 5), 0, 4);
          ++coverage.corners_per_cell[static_cast<std::size_t>(8 * y + x)];
        }
      }
    }
    coverage.unreachable[39] = coverage.corners_per_cell[39] < 12;
    coverage.near_views = 20;
    coverage.far_views = 18;
    coverage.tilt_bins = {{"frontal", 9}, {"pitch+", 6}, {"pitch-", 7}, {"yaw+", 8}, {"yaw-", 8}};
    return coverage;
  }

  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace servocal::test
