// SPDX-License-Identifier: GPL-3.0-or-later
// Eyes for tests of the servo loop: projects the true target through the true camera, late and noisy, and
// estimates its pose with the camera model the loop believes in. No images.
#pragma once

#include <Eigen/Cholesky>
#include <functional>
#include <random>
#include <utility>
#include <vector>

#include "fake_arm.h"
#include "servocal/servo/drive.h"

namespace servocal::test {

/// Pose of points from their pixels by Gauss-Newton from `start`.
inline Pose<Color, Board> refinePose(const CameraModel& camera, const std::vector<Eigen::Vector3d>& points_o,
                                     const std::vector<Eigen::Vector2d>& pixels, Pose<Color, Board> cMo) {
  for (int iteration = 0; iteration < 10; ++iteration) {
    Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> right = Eigen::Matrix<double, 6, 1>::Zero();
    for (std::size_t i = 0; i < points_o.size(); ++i) {
      const Eigen::Vector3d point_c = cMo * points_o[i];
      ProjectionJacobian jacobian;
      const auto pixel = camera.project(point_c, jacobian);
      if (!pixel) continue;
      Eigen::Matrix<double, 3, 6> motion;
      motion << Eigen::Matrix3d::Identity(), (Eigen::Matrix3d() << 0, point_c.z(), -point_c.y(), -point_c.z(),
                                              0, point_c.x(), point_c.y(), -point_c.x(), 0).finished();
      const Eigen::Matrix<double, 2, 6> row = jacobian.point * motion;
      normal += row.transpose() * row;
      right += row.transpose() * (pixels[i] - *pixel);
    }
    const Eigen::Matrix<double, 6, 1> step = normal.ldlt().solve(right);
    const auto turn = Pose<Color, Color>::fromRotationVector(step.tail<3>(), step.head<3>());
    cMo = turn * cMo;
    if (step.norm() < 1e-10) break;
  }
  return cMo;
}

struct FakeObserverOptions {
  double rate_hz = 30.0;
  double latency_s = 0.065;  ///< Middle of the exposure to delivery.
  double noise_px = 0.1;     ///< Standard deviation per axis.
  unsigned seed = 1;
};

class FakeObserver final : public servo::Observer {
 public:
  FakeObserver(FakeArm& arm, Clock& clock, std::vector<Eigen::Vector3d> points_o, CameraModel true_camera,
               CameraModel believed_camera, const Pose<Base, Color>& bMc,
               const Pose<EndEffector, Board>& eMo, const FakeObserverOptions& options = {})
      : arm_(arm), clock_(clock), points_o_(std::move(points_o)), true_camera_(std::move(true_camera)),
        believed_camera_(std::move(believed_camera)), cMb_(bMc.inverse()), eMo_(eMo), options_(options),
        random_(options.seed) {}

  servo::Look look(Instant deadline) override {
    // The newest frame delivered by now that was not handed out; else the next one.
    const double period = 1.0 / options_.rate_hz;
    const auto delivered = [&](long index) { return Instant(fromSeconds(index * period + options_.latency_s)); };
    long index = static_cast<long>(std::floor((toSeconds(clock_.now()) - options_.latency_s) / period + 1e-9));
    if (index <= last_index_) index = last_index_ + 1;
    if (index < 0) index = 0;
    if (delivered(index) > deadline || dead) {
      clock_.sleepUntil(deadline);
      return {};
    }
    clock_.sleepUntil(delivered(index));
    last_index_ = index;

    servo::Look look;
    const Instant stamp(fromSeconds(index * period));
    look.frame = stamp + stamp_error;
    const RobotState state = arm_.stateAt(stamp);
    const Pose<Color, Board> cMo = cMb_ * state.bMe * eMo_;
    servo::Sight sight;
    sight.stamp = *look.frame;
    std::normal_distribution<double> noise(0.0, options_.noise_px);
    bool seen = !visible || visible(stamp, state);
    for (const Eigen::Vector3d& point_o : points_o_) {
      const auto pixel = true_camera_.project(cMo * point_o);
      if (!pixel || !true_camera_.contains(*pixel, 2.0)) {
        seen = false;
        break;
      }
      const double u = noise(random_), v = noise(random_);
      sight.pixels.push_back(*pixel + Eigen::Vector2d(u, v));
    }
    if (!seen) return look;
    sight.cMo = refinePose(believed_camera_, points_o_, sight.pixels, cMo);
    last_seen = stamp;
    look.sight = std::move(sight);
    return look;
  }

  /// Whether the target is seen in the frame exposed then (besides being in the image). Empty: always.
  std::function<bool(Instant, const RobotState&)> visible;
  bool dead = false;         ///< No frames come.
  Duration stamp_error{};    ///< Added to the reported stamps.
  std::optional<Instant> last_seen;  ///< True stamp of the last frame that showed the target.

 private:
  FakeArm& arm_;
  Clock& clock_;
  std::vector<Eigen::Vector3d> points_o_;
  CameraModel true_camera_, believed_camera_;
  Pose<Color, Base> cMb_;
  Pose<EndEffector, Board> eMo_;
  FakeObserverOptions options_;
  std::mt19937_64 random_;
  long last_index_ = -1;
};

}  // namespace servocal::test
