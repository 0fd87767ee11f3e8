// SPDX-License-Identifier: GPL-3.0-or-later
#include "plane_gaps.h"

#include <Eigen/SVD>
#include <algorithm>
#include <chrono>
#include <cmath>

#include "servocal/robot/path_planner.h"
#include "servocal/sensor/rectify.h"
#include "servocal/servo/follow_path.h"

namespace servocal::test {
namespace {

constexpr int kFrames = 5;  // The paper's number.
constexpr std::size_t kLeastPoints = 500;
constexpr double kRimM = 0.005;  // Left out along the border of the pattern: pixels there mix near and far.
constexpr double kThicknessM =
    0.04;  // Around where the robot says that the board is; raw depth is off by up to 25 mm.

bool measuresByTime(const CameraResult& camera) {
  return camera.hand_eye && camera.color_infrared && camera.depth &&
         camera.depth->model.sensor == DepthSensor::kTimeOfFlight;
}

Pose<EndEffector, Board> mountOf(const CalibrationResult& result) {
  return Pose<EndEffector, Board>(result.cameras.front().hand_eye->board_pose);
}

/// Turned about its normal so that the arm gets there by the shortest way; nothing if it does not.
std::optional<Pose<Base, EndEffector>> flangeFor(const robot::Guard& guard, const Eigen::VectorXd& q_now,
                                                 const Eigen::Vector3d& place, const Eigen::Vector3d& viewer,
                                                 const Pose<EndEffector, Board>& eMo) {
  const Eigen::Vector3d z = (place - viewer).normalized(), x = z.unitOrthogonal();
  Eigen::Matrix3d upright;
  upright << x, z.cross(x), z;
  std::optional<Pose<Base, EndEffector>> best;
  double shortest_rad = INFINITY;
  for (int turn = 0; turn < 12; ++turn) {
    const Eigen::AngleAxisd about_normal(turn * M_PI / 6, Eigen::Vector3d::UnitZ());
    const Pose<Base, EndEffector> bMe =
        Pose<Base, Board>(upright * about_normal.toRotationMatrix(), place) * eMo.inverse();
    const auto q = guard.kinematics().inverse(bMe, q_now, guard.limits().joint_margin_rad);
    if (!q || !guard.allows(*q)) continue;
    const double way_rad = (*q - q_now).cwiseAbs().maxCoeff();
    if (way_rad < shortest_rad) {
      shortest_rad = way_rad;
      best = bMe;
    }
  }
  return best;
}

std::vector<cv::Mat> depthFrames(sensor::RgbdCamera& camera, Clock& clock) {
  const Instant rest = clock.now();
  std::vector<cv::Mat> frames;
  while (frames.size() < kFrames && clock.now() < rest + std::chrono::seconds(2)) {
    const auto frame = camera.next(Stream::kDepth, clock.now() + std::chrono::milliseconds(200));
    if (frame && frame->stamp > rest) frames.push_back(frame->image.clone());
  }
  return frames;
}

struct Plane {
  Eigen::Vector3d middle, normal;
  int points = 0;
};

/// Least squares over the points within three robust sigmas of it.
Plane fit(const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3d> near = points;
  Plane plane;
  for (int iteration = 0; iteration < 8; ++iteration) {
    Eigen::Matrix3Xd cloud(3, static_cast<Eigen::Index>(near.size()));
    for (std::size_t i = 0; i < near.size(); ++i) cloud.col(static_cast<Eigen::Index>(i)) = near[i];
    plane.middle = cloud.rowwise().mean();
    const Eigen::Matrix3Xd centred = cloud.colwise() - plane.middle;
    const Eigen::Matrix3d moments = centred * centred.transpose();
    plane.normal = moments.jacobiSvd(Eigen::ComputeFullU).matrixU().col(2);
    plane.points = static_cast<int>(near.size());
    const auto off = [&](const Eigen::Vector3d& point) {
      return std::abs(plane.normal.dot(point - plane.middle));
    };
    std::vector<double> distances;
    for (const Eigen::Vector3d& point : points) distances.push_back(off(point));
    std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
    const double limit_m = 3 * 1.4826 * distances[distances.size() / 2];
    near.clear();
    std::copy_if(points.begin(), points.end(), std::back_inserter(near),
                 [&](const Eigen::Vector3d& point) { return off(point) < limit_m; });
  }
  return plane;
}

/// The points of the board in the base.
std::vector<Eigen::Vector3d> boardCloud(const CalibrationResult& result, const CameraResult& camera,
                                        const PlaneShot& shot, Cloud cloud) {
  const DepthModel& model = camera.depth->model;
  const Pose<Color, Infrared> cMi(camera.color_infrared->first_by_second);
  const sensor::DepthRectifier rectifier(model, camera.intrinsics.camera, cMi);
  const Pose<Base, Infrared> bMi = Pose<Base, Color>(camera.hand_eye->camera_pose) * cMi;
  const Pose<Board, Base> oMb = (shot.bMe * mountOf(result)).inverse();
  const Eigen::Vector3d corner =
      result.board.patternOutline()[2];  // Lower right: half the size of the pattern.
  std::vector<Eigen::Vector3d> points;
  for (const cv::Mat& raw : shot.depth.at(camera.camera)) {
    cv::Mat depth_m;
    if (cloud == Cloud::kRaw) {
      raw.convertTo(depth_m, CV_32F, 0.001);
    } else {
      depth_m = rectifier.corrected(raw);
    }
    for (int row = 0; row < depth_m.rows; ++row) {
      for (int column = 0; column < depth_m.cols; ++column) {
        const double z_m = depth_m.at<float>(row, column);
        if (z_m <= 0.0) continue;
        const auto ray = model.camera.unproject(Eigen::Vector2d(column, row));
        if (!ray) continue;
        const Eigen::Vector3d in_base = bMi * Eigen::Vector3d(z_m * ray->homogeneous());
        const Eigen::Vector3d in_board = oMb * in_base;
        const bool is_board = std::abs(in_board.x()) < corner.x() - kRimM &&
                              std::abs(in_board.y()) < corner.y() - kRimM &&
                              std::abs(in_board.z()) < kThicknessM;
        if (is_board) points.push_back(in_base);
      }
    }
  }
  return points;
}

const CameraResult& cameraOf(const CalibrationResult& result, const std::string& name) {
  return *std::find_if(result.cameras.begin(), result.cameras.end(),
                       [&](const CameraResult& camera) { return camera.camera == name; });
}

}  // namespace

std::vector<PlaneShot> shootPlanes(const CellConfig& cell, const CalibrationResult& result,
                                   sim::Cell& simulation, robot::Guard& guard) {
  std::vector<std::string> names;
  Eigen::Vector3d viewer = Eigen::Vector3d::Zero();
  for (const CameraResult& camera : result.cameras) {
    if (!measuresByTime(camera)) continue;
    names.push_back(camera.camera);
    viewer += camera.hand_eye->camera_pose.translation();
  }
  if (names.size() < 2 || cell.cameras.front().mount == Mount::kFlange) return {};
  viewer /= static_cast<double>(names.size());
  const Pose<EndEffector, Board> eMo = mountOf(result);
  const Eigen::Vector3d middle = guard.kinematics().forward(cell.arm.start_q) * eMo.translation();
  const Eigen::Vector3d ahead = (viewer - middle).normalized(), up = Eigen::Vector3d::UnitZ(),
                        aside = up.cross(ahead);
  std::vector<PlaneShot> shots;
  for (const auto& [forward_m, aside_m, up_m] : std::initializer_list<std::array<double, 3>>{
           {0, 0, 0}, {0.06, 0.10, 0.06}, {-0.06, -0.10, 0.06}, {-0.06, 0.10, -0.06}, {0.06, -0.10, -0.06}}) {
    const Eigen::Vector3d place = middle + forward_m * ahead + aside_m * aside + up_m * up;
    const Eigen::VectorXd q_now = guard.state().q;
    const auto bMe = flangeFor(guard, q_now, place, viewer, eMo);
    if (!bMe) continue;
    const robot::Plan plan = robot::planTo(guard, q_now, *bMe);
    if (plan.path.empty()) continue;
    if (servo::followPath(guard, simulation.clock(), plan.path).status != DriveStatus::kReached) continue;
    guard.stopAndWait();
    PlaneShot shot{guard.state().bMe, {}};
    for (const std::string& name : names)
      shot.depth[name] = depthFrames(simulation.camera(name), simulation.clock());
    shots.push_back(std::move(shot));
  }
  return shots;
}

std::vector<PlaneGap> planeGaps(const CalibrationResult& result, const std::vector<PlaneShot>& shots,
                                const std::string& first, const std::string& second, Cloud cloud) {
  const CameraResult &one = cameraOf(result, first), &other = cameraOf(result, second);
  std::vector<PlaneGap> gaps;
  for (const PlaneShot& shot : shots) {
    const auto cloud_one = boardCloud(result, one, shot, cloud),
               cloud_other = boardCloud(result, other, shot, cloud);
    if (std::min(cloud_one.size(), cloud_other.size()) < kLeastPoints) continue;
    Plane a = fit(cloud_one);
    const Plane b = fit(cloud_other);
    if (a.normal.dot(one.hand_eye->camera_pose.translation() - a.middle) < 0) a.normal = -a.normal;
    gaps.push_back({a.normal.dot(b.middle - a.middle),
                    std::acos(std::min(1.0, std::abs(a.normal.dot(b.normal)))),
                    std::min(a.points, b.points)});
  }
  return gaps;
}

}  // namespace servocal::test
