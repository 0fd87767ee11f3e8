// SPDX-License-Identifier: GPL-3.0-or-later
#include "check_model.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "check_prior.h"
#include "servocal/calib/board_pose.h"

namespace servocal::procedure {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kFreeM = 1.0, kFreeRad = 1.0;  // standard deviation of what is set free
constexpr double kFreeFocal = 0.1, kFreePrincipal = 0.05,
                 kFreeDistortion = 0.3;  // of f, of the width, absolute
constexpr double kKnownExactly =
    1e-9;                       // share of the free deviation, for intrinsics that came without covariance
constexpr double kAlike = 0.3;  // share of the robot's error that all stops of a check have in common
constexpr double kBeyondClaim = 1.4;  // standard deviations of intrinsics over those that are claimed
constexpr double kLostCorner = 1e4;   // cost of a corner that cannot be where it is seen
constexpr int kIterations = 30;

Matrix3d skew(const Vector3d& v) {
  Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Matrix3d turn(const Vector3d& rotation_rad) {
  const double angle = rotation_rad.norm();
  return angle > 0.0 ? Eigen::AngleAxisd(angle, rotation_rad / angle).toRotationMatrix()
                     : Matrix3d(Matrix3d::Identity());
}

Vector3d rotationVector(const Matrix3d& rotation) {
  const Eigen::AngleAxisd angle_axis(rotation);
  return angle_axis.angle() * angle_axis.axis();
}

/// Displaces the origin and turns about it, along the axes of the pose's left frame.
Eigen::Isometry3d displaced(const Eigen::Isometry3d& pose, const Vector6d& by) {
  Eigen::Isometry3d result = pose;
  result.linear() = turn(by.tail<3>()) * pose.linear();
  result.translation() += by.head<3>();
  return result;
}

Vector6d displacement(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to) {
  Vector6d by;
  by << to.translation() - from.translation(), rotationVector(to.linear() * from.linear().transpose());
  return by;
}

/// The pose whose displacement from `from` is the mean of the others'.
Eigen::Isometry3d meanPose(const Eigen::Isometry3d& from, const std::vector<Eigen::Isometry3d>& poses) {
  Vector6d sum = Vector6d::Zero();
  for (const Eigen::Isometry3d& pose : poses) sum += displacement(from, pose);
  return displaced(from, sum / static_cast<double>(poses.size()));
}

Eigen::VectorXd freeIntrinsics(const CameraModel& camera) {
  Eigen::VectorXd sigma = Eigen::VectorXd::Constant(camera.parameters.size(), kFreeDistortion);
  sigma.head<4>() << kFreeFocal * camera.fx(), kFreeFocal * camera.fy(), kFreePrincipal * camera.width_px,
      kFreePrincipal * camera.width_px;
  return sigma;
}

/// Of a positive definite matrix, on its scaling to a unit diagonal: parameters differ by orders of
/// magnitude.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& covariance) {
  const Eigen::VectorXd scale = covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * covariance * scale.asDiagonal();
  return scale.asDiagonal() * scaled.ldlt().solve(Eigen::MatrixXd::Identity(scaled.rows(), scaled.cols())) *
         scale.asDiagonal();
}

bool contains(const std::vector<std::size_t>& list, std::size_t value) {
  return std::find(list.begin(), list.end(), value) != list.end();
}

}  // namespace

double chiSquareTail(double value, int degrees) {
  // Abramowitz & Stegun 26.4.4 and 26.4.5, as a recursion over the degrees of freedom.
  const double half = 0.5 * std::max(value, 0.0);
  double tail = degrees % 2 == 0 ? std::exp(-half) : std::erfc(std::sqrt(half));
  for (int k = degrees % 2 == 0 ? 2 : 1; k < degrees; k += 2) {
    tail += std::exp(0.5 * k * std::log(half) - half - std::lgamma(0.5 * k + 1.0));
  }
  return value > 0.0 ? std::min(tail, 1.0) : 1.0;
}

struct CheckModel::State {
  std::vector<Eigen::Isometry3d> bMc;
  std::vector<CameraModel> models;
  std::vector<Vector6d> boards;       ///< Displacement of each camera's own eMo, as far as it was known;
  Vector6d mount = Vector6d::Zero();  ///< and that of all since.
  std::vector<Vector6d> stops;        ///< Displacement and turn of the flange, along its axes.
};

CheckModel::CheckModel(const CalibrationResult& stored, const std::vector<Observation>& observations,
                       const CheckOptions& options)
    : stored_(stored), options_(options) {
  if (!(options.robot_sigma_m > 0.0) || !(options.robot_sigma_rad > 0.0)) {
    throw std::invalid_argument("check: the robot's standard deviations must be positive");
  }
  for (const CameraResult& camera : stored.cameras) {
    if (!camera.hand_eye || camera.hand_eye->mount != Mount::kFixed) continue;
    const CameraModel& model = camera.intrinsics.camera;
    Eigen::MatrixXd covariance = camera.intrinsics.covariance;
    const Eigen::VectorXd least = kKnownExactly * freeIntrinsics(model);
    if (covariance.rows() != model.parameters.size() || !covariance.allFinite()) {
      covariance.setZero(model.parameters.size(), model.parameters.size());
    }
    covariance *= kBeyondClaim * kBeyondClaim;
    covariance.diagonal() += least.cwiseAbs2();
    cameras_.push_back({&camera, covariance, Eigen::MatrixXd::Zero(6, covariance.rows()), size_});
    size_ += 12 + static_cast<int>(model.parameters.size());
  }
  for (const Observation& observation : observations) {
    if (!observation.robot) continue;
    const std::size_t stop = stops_.size();
    for (const StreamObservation& seen : observation.views) {
      for (std::size_t c = 0; c < cameras_.size(); ++c) {
        const CameraResult& camera = *cameras_[c].stored;
        if (seen.stream != Stream::kColor || seen.camera != camera.camera) continue;
        const Pose<Color, Board> expected(camera.hand_eye->camera_pose.inverse() *
                                          observation.robot->bMe.isometry() * camera.hand_eye->board_pose);
        auto poses = calib::boardPoses(stored.board, camera.intrinsics.camera, seen.detection);
        if (poses.empty()) continue;
        // Of the two poses of a plane the one that goes with the stored calibration: it can only be off a
        // little.
        if (poses.size() > 1 && angleRad(poses[1].cMo, expected) < angleRad(poses[0].cMo, expected)) {
          std::swap(poses[0], poses[1]);
        }
        const double claimed_px = std::sqrt(seen.detection.corners.front().covariance_px2.trace());
        views_.push_back(
            {c, stop, seen.detection, poses[0].cMo, std::max(1.0, poses[0].rms_px / claimed_px)});
      }
    }
    if (!views_.empty() && views_.back().stop == stop) stops_.push_back(observation.robot->bMe);
  }
  Vector6d robot;
  robot << Vector3d::Constant(options.robot_sigma_m), Vector3d::Constant(options.robot_sigma_rad);
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    double near_m = INFINITY;
    for (const View& view : views_) {
      if (view.camera == c) near_m = std::min(near_m, view.seen.translation().z());
    }
    if (!std::isfinite(near_m)) continue;  // It saw nothing.
    const CameraResult& camera = *cameras_[c].stored;
    cameras_[c].pose_by_intrinsics =
        poseByIntrinsics(stored.board, camera.intrinsics.camera, *camera.hand_eye, near_m, robot);
  }
  mount_at_ = size_;
  stops_at_ = mount_at_ + 6;
  size_ = stops_at_ + 6 * static_cast<int>(stops_.size());
}

int CheckModel::views(std::size_t camera) const {
  return static_cast<int>(
      std::count_if(views_.begin(), views_.end(), [&](const View& view) { return view.camera == camera; }));
}

double CheckModel::rmsPx(std::size_t camera) const {
  const CameraResult& stored = *cameras_[camera].stored;
  double squares = 0.0;
  int corners = 0;
  for (const View& view : views_) {
    if (view.camera != camera) continue;
    const Eigen::Isometry3d cMo =
        stored.hand_eye->camera_pose.inverse() * stops_[view.stop].isometry() * stored.hand_eye->board_pose;
    for (const Corner& corner : view.detection.corners) {
      const auto pixel = stored.intrinsics.camera.project(cMo * stored_.board.corner(corner.id));
      if (!pixel) continue;
      squares += (*pixel - corner.pixel).squaredNorm();
      ++corners;
    }
  }
  return corners > 0 ? std::sqrt(squares / corners) : 0.0;
}

CheckModel::State CheckModel::startOf(const FreeParts& free) const {
  State state;
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    const HandEyeSolution& hand_eye = *cameras_[c].stored->hand_eye;
    std::vector<Eigen::Isometry3d> poses;
    for (const View& view : views_) {
      if (view.camera == c) {
        poses.push_back(stops_[view.stop].isometry() * hand_eye.board_pose * view.seen.inverse().isometry());
      }
    }
    const bool moves = contains(free.cameras, c) && !poses.empty();
    state.bMc.push_back(moves ? meanPose(hand_eye.camera_pose, poses) : hand_eye.camera_pose);
    state.models.push_back(cameras_[c].stored->intrinsics.camera);
  }
  if (free.mount) {
    Vector6d sum = Vector6d::Zero();
    int count = 0;
    for (const View& view : views_) {
      if (contains(free.cameras, view.camera)) continue;
      const HandEyeSolution& hand_eye = *cameras_[view.camera].stored->hand_eye;
      sum += displacement(hand_eye.board_pose, stops_[view.stop].inverse().isometry() * hand_eye.camera_pose *
                                                   view.seen.isometry());
      ++count;
    }
    if (count > 0) state.mount = sum / count;
  }
  state.boards.assign(cameras_.size(), Vector6d::Zero());
  state.stops.assign(stops_.size(), Vector6d::Zero());
  return state;
}

Eigen::MatrixXd CheckModel::priorInformation(const FreeParts& free) const {
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size_, size_);
  Vector6d robot, wide;
  robot << Vector3d::Constant(options_.robot_sigma_m), Vector3d::Constant(options_.robot_sigma_rad);
  wide << Vector3d::Constant(kFreeM), Vector3d::Constant(kFreeRad);
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    const Camera& camera = cameras_[c];
    Vector6d variance = camera.stored->hand_eye->camera_sigma.cwiseAbs2() + (kAlike * robot).cwiseAbs2();
    if (contains(free.cameras, c)) variance += wide.cwiseAbs2();
    const auto count = camera.intrinsics_covariance.rows();
    Eigen::MatrixXd follows(6 + count, count);  // What was off when it was calibrated.
    follows << camera.pose_by_intrinsics, Eigen::MatrixXd::Identity(count, count);
    Eigen::MatrixXd covariance = follows * camera.intrinsics_covariance * follows.transpose();
    covariance.diagonal().head<6>() += variance;
    if (contains(free.intrinsics, c)) {
      covariance.diagonal().tail(count) += freeIntrinsics(camera.stored->intrinsics.camera).cwiseAbs2();
    }
    information.block(camera.at, camera.at, 6 + count, 6 + count) = inverse(covariance);
    const int board_at = camera.at + 6 + static_cast<int>(count);
    information.block(board_at, board_at, 6, 6) =
        camera.stored->hand_eye->board_sigma.cwiseAbs2().cwiseInverse().asDiagonal();
  }
  const Vector6d mount = free.mount ? wide : Vector6d(kKnownExactly * wide);
  information.block(mount_at_, mount_at_, 6, 6) = mount.cwiseAbs2().cwiseInverse().asDiagonal();
  for (int at = stops_at_; at < size_; at += 6) {
    information.block(at, at, 6, 6) = robot.cwiseAbs2().cwiseInverse().asDiagonal();
  }
  return information;
}

Eigen::VectorXd CheckModel::deviation(const State& state) const {
  Eigen::VectorXd deviation(size_);
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    const CameraResult& stored = *cameras_[c].stored;
    const CameraModel& model = stored.intrinsics.camera;
    deviation.segment<6>(cameras_[c].at) = displacement(stored.hand_eye->camera_pose, state.bMc[c]);
    deviation.segment(cameras_[c].at + 6, model.parameters.size()) =
        state.models[c].parameters - model.parameters;
    deviation.segment<6>(cameras_[c].at + 6 + model.parameters.size()) = state.boards[c];
  }
  deviation.segment<6>(mount_at_) = state.mount;
  for (std::size_t i = 0; i < stops_.size(); ++i) {
    deviation.segment<6>(stops_at_ + 6 * static_cast<int>(i)) = state.stops[i];
  }
  return deviation;
}

CheckModel::State CheckModel::moved(const State& state, const Eigen::VectorXd& step) const {
  const auto compose = [](const Vector6d& old, const Vector6d& by) {
    Vector6d sum;
    sum << old.head<3>() + by.head<3>(), rotationVector(turn(by.tail<3>()) * turn(old.tail<3>()));
    return sum;
  };
  State result = state;
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    result.bMc[c] = displaced(state.bMc[c], step.segment<6>(cameras_[c].at));
    const Eigen::Index p = state.models[c].parameters.size();
    result.models[c].parameters += step.segment(cameras_[c].at + 6, p);
    result.boards[c] = compose(state.boards[c], step.segment<6>(cameras_[c].at + 6 + p));
  }
  result.mount = compose(state.mount, step.segment<6>(mount_at_));
  for (std::size_t i = 0; i < stops_.size(); ++i) {
    result.stops[i] = compose(state.stops[i], step.segment<6>(stops_at_ + 6 * static_cast<int>(i)));
  }
  return result;
}

double CheckModel::costOf(const State& state, const Eigen::MatrixXd& prior, Eigen::MatrixXd* information,
                          Eigen::VectorXd* gradient) const {
  const Eigen::VectorXd off = deviation(state);
  double cost = off.dot(prior * off);
  if (information != nullptr) {
    *information = prior;
    *gradient = prior * off;
  }
  for (const View& view : views_) {
    const std::size_t c = view.camera;
    const int p = static_cast<int>(state.models[c].parameters.size());
    const Eigen::Isometry3d eMo =
        displaced(cameras_[c].stored->hand_eye->board_pose, state.mount + state.boards[c]);
    const Vector6d& correction = state.stops[view.stop];
    const Matrix3d corrected = turn(correction.tail<3>()), bRe = stops_[view.stop].rotation();
    const Matrix3d cRb = state.bMc[c].linear().transpose();
    Eigen::MatrixXd view_information = Eigen::MatrixXd::Zero(18 + p, 18 + p);
    Eigen::VectorXd view_gradient = Eigen::VectorXd::Zero(18 + p);
    for (const Corner& corner : view.detection.corners) {
      const Vector3d point_o = stored_.board.corner(corner.id);
      const Vector3d point_e = eMo * point_o, turned_e = corrected * point_e;
      const Vector3d point_b = stops_[view.stop] * Vector3d(turned_e + correction.head<3>());
      const Vector3d from_camera_b = point_b - state.bMc[c].translation();
      ProjectionJacobian by;
      const auto pixel = state.models[c].project(cRb * from_camera_b, by);
      if (!pixel) {
        cost += kLostCorner;
        continue;
      }
      const Eigen::Vector2d residual = *pixel - corner.pixel;
      const Eigen::Matrix2d weight = (corner.covariance_px2 * view.noise_scale * view.noise_scale).inverse();
      cost += residual.dot(weight * residual);
      if (information == nullptr) continue;
      Eigen::MatrixXd jacobian(2, 18 + p);  // camera, intrinsics, mount, stop
      const Eigen::Matrix<double, 2, 3> by_b = by.point * cRb, by_e = by_b * bRe;
      jacobian.middleCols<3>(0) = -by_b;
      jacobian.middleCols<3>(3) = by_b * skew(from_camera_b);
      jacobian.middleCols(6, p) = by.parameters;
      jacobian.middleCols<3>(6 + p) = by_e * corrected;
      jacobian.middleCols<3>(9 + p) = -by_e * corrected * skew(eMo.linear() * point_o);
      jacobian.middleCols<3>(12 + p) = by_e;
      jacobian.middleCols<3>(15 + p) = -by_e * skew(turned_e);
      view_information.noalias() += jacobian.transpose() * weight * jacobian;
      view_gradient.noalias() += jacobian.transpose() * weight * residual;
    }
    if (information == nullptr) continue;
    const std::array<std::array<int, 3>, 4> blocks = {
        {{cameras_[c].at, 0, 6 + p},
         {cameras_[c].at + 6 + p, 6 + p, 6},  // one and the same to the image: the board by this camera
         {mount_at_, 6 + p, 6},               // and the mount

         {stops_at_ + 6 * static_cast<int>(view.stop), 12 + p, 6}}};
    for (const auto& [row, view_row, rows] : blocks) {
      gradient->segment(row, rows) += view_gradient.segment(view_row, rows);
      for (const auto& [column, view_column, columns] : blocks) {
        information->block(row, column, rows, columns) +=
            view_information.block(view_row, view_column, rows, columns);
      }
    }
  }
  return cost;
}

CheckFit CheckModel::fit(const FreeParts& free) const {
  const Eigen::MatrixXd prior = priorInformation(free);
  State state = startOf(free);
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;
  double cost = costOf(state, prior, &information, &gradient), damping = 1e-6;
  for (int i = 0; i < kIterations && damping < 1e6; ++i) {
    Eigen::MatrixXd damped = information;
    damped.diagonal() *= 1.0 + damping;
    const State next = moved(state, -damped.ldlt().solve(gradient));
    const double next_cost = costOf(next, prior, nullptr, nullptr);
    if (!(next_cost < cost)) {
      damping *= 10.0;
      continue;
    }
    const bool converged = cost - next_cost < 1e-6 * (1.0 + cost);
    state = next;
    cost = costOf(state, prior, &information, &gradient);
    damping = std::max(1e-9, 0.1 * damping);
    if (converged) break;
  }
  const Eigen::VectorXd off = deviation(state);
  const Eigen::VectorXd sigma =
      information.ldlt().solve(Eigen::MatrixXd::Identity(size_, size_)).diagonal().cwiseMax(0.0).cwiseSqrt();
  CheckFit fit;
  fit.cost = cost;
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    const int at = cameras_[c].at, p = intrinsics(c);
    fit.cameras.push_back(off.segment(at, 6));
    fit.cameras_sigma.push_back(sigma.segment(at, 6));
    fit.intrinsics.push_back(off.segment(at + 6, p));
    fit.intrinsics_sigma.push_back(sigma.segment(at + 6, p));
  }
  fit.mount = off.segment(mount_at_, 6);
  fit.mount_sigma = sigma.segment(mount_at_, 6);
  return fit;
}

}  // namespace servocal::procedure
