// SPDX-License-Identifier: GPL-3.0-or-later
#include "reachable_cells.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "ur5.h"

namespace servocal::test {
namespace {

using sim::Ur5;
using sim::Vector6d;

/// Numerical inverse kinematics (damped least squares) from several starts.
class Inverse {
 public:
  Inverse(const Eigen::VectorXd& start_q, double joint_margin_rad)
      : limit_(Ur5::kJointLimitRad - joint_margin_rad) {
    starts_.push_back(start_q);
    // The other branches of the same arm: elbow, wrist and shoulder turned over.
    Vector6d elbow = start_q;
    elbow[1] += elbow[2];
    elbow[3] += elbow[2];
    elbow[2] = -elbow[2];
    Vector6d wrist = start_q;
    wrist[3] += M_PI;
    wrist[4] = -wrist[4];
    wrist[5] += M_PI;
    Vector6d shoulder = start_q;
    shoulder[0] += M_PI;
    shoulder[1] = -M_PI - shoulder[1];
    shoulder[2] = -shoulder[2];
    starts_.insert(starts_.end(), {elbow, wrist, shoulder});
  }

  std::optional<Vector6d> solve(const Eigen::Isometry3d& bMe) {
    // Out of any reach: wrist centre farther from the shoulder than both links and the wrist's offset.
    const Eigen::Vector3d wrist = bMe * Eigen::Vector3d(0.0, 0.0, -0.0823);
    if ((wrist - Eigen::Vector3d(0.0, 0.0, 0.089159)).norm() > 0.93) return std::nullopt;
    if (last_) {
      if (const auto q = from(*last_, bMe)) return last_ = q;
    }
    for (const Vector6d& start : starts_) {
      // The base joint and the last one turn freely; begin with the base towards the flange.
      for (const double turn : {0.0, M_PI}) {
        Vector6d seed = start;
        seed[5] += turn;
        if (const auto q = from(seed, bMe)) return last_ = q;
      }
    }
    return std::nullopt;
  }

 private:
  std::optional<Vector6d> from(Vector6d q, const Eigen::Isometry3d& bMe) const {
    double best = 1e9;
    for (int iteration = 0; iteration < 40; ++iteration) {
      const Eigen::Isometry3d reached = arm_.forward(q);
      const Eigen::AngleAxisd turn(bMe.linear() * reached.linear().transpose());
      Vector6d error;
      error << bMe.translation() - reached.translation(), turn.angle() * turn.axis();
      if (error.head<3>().norm() < 1e-4 && error.tail<3>().norm() < 1e-4) return legal(q);
      if (iteration == 15 && error.norm() > 0.5 * best) break;  // Stuck: another start is cheaper.
      best = std::min(best, error.norm());
      const sim::Matrix6d jacobian = arm_.jacobian(q);
      const sim::Matrix6d squared = jacobian * jacobian.transpose() +
                                    1e-3 * std::min(1.0, error.norm()) * sim::Matrix6d::Identity();
      Vector6d step = jacobian.transpose() * squared.ldlt().solve(error);
      const double largest = step.cwiseAbs().maxCoeff();
      if (largest > 0.4) step *= 0.4 / largest;
      q += step;
    }
    return std::nullopt;
  }

  std::optional<Vector6d> legal(Vector6d q) const {
    for (double& angle : q) {
      while (angle > limit_) angle -= 2.0 * M_PI;
      while (angle < -limit_) angle += 2.0 * M_PI;
      if (std::abs(angle) > limit_) return std::nullopt;
    }
    return q;
  }

  Ur5 arm_;
  double limit_;
  std::vector<Vector6d> starts_;
  std::optional<Vector6d> last_;
};

bool boxesAllow(const MotionLimits& limits, const Eigen::Vector3d& point_b) {
  const bool bounded = (limits.workspace.max_m.array() > limits.workspace.min_m.array()).all();
  if (bounded && !limits.workspace.contains(point_b)) return false;
  return std::none_of(limits.keep_out.begin(), limits.keep_out.end(),
                      [&](const Box& box) { return box.contains(point_b); });
}

/// One orientation and distance of the board, and which of its points is put into the cell.
struct Candidate {
  double distance_m;
  Eigen::Matrix3d rotation;
  Eigen::Vector3d anchor_o;
};

std::vector<Candidate> candidates(const BoardSpec& board, const ReachSearch& search) {
  std::vector<double> distances;
  for (double z = 0.5; z <= search.farthest_m + 1e-9; z += 0.1) distances.push_back(z);
  for (double z = 0.45; z >= search.nearest_m - 1e-9; z -= 0.05) distances.push_back(z);
  std::vector<std::pair<double, double>> tilts = {{0.0, 0.0}};
  for (const double share : {0.5, 1.0}) {
    for (int i = 0; i < 8; ++i) tilts.emplace_back(share * search.max_tilt_rad, i * M_PI / 4);
  }
  const Eigen::Vector3d far = board.corner(board.cornerCount() - 1);
  const double x = 0.5 * far.x(), y = 0.5 * far.y();
  std::vector<Candidate> all;
  for (const auto& [tilt, direction] : tilts) {
    for (const double z : distances) {
      for (int roll = 0; roll < 8; ++roll) {
        const Eigen::Matrix3d rotation =
            (Eigen::AngleAxisd(tilt, Eigen::Vector3d(std::cos(direction), std::sin(direction), 0.0)) *
             Eigen::AngleAxisd(roll * M_PI / 4, Eigen::Vector3d::UnitZ()))
                .toRotationMatrix();
        for (const double ax : {0.0, -1.0, 1.0}) {
          for (const double ay : {0.0, -1.0, 1.0}) all.push_back({z, rotation, {ax * x, ay * y, 0.0}});
        }
      }
    }
  }
  return all;
}

}  // namespace

int ReachableCells::count() const {
  return static_cast<int>(std::count_if(cells.begin(), cells.end(), [](const auto& cell) { return !!cell; }));
}

ReachableCells reachableCells(const CellConfig& config, const sim::Truth& truth, const std::string& camera,
                              const ReachSearch& search) {
  const bool color = search.stream == Stream::kColor;
  const CameraModel model = color ? truth.camera(camera) : truth.infrared(camera);
  Pose<Base, Color> bMc = truth.bMc(camera);
  if (!color) bMc = Pose<Base, Color>((bMc * truth.cMi(camera)).isometry());
  const Pose<Board, EndEffector> oMe = truth.eMo().inverse();
  const double cell_width = static_cast<double>(model.width_px) / config.coverage.cells_x;
  const double cell_height = static_cast<double>(model.height_px) / config.coverage.cells_y;
  const std::vector<Eigen::Vector3d> corners = config.board.corners();
  const std::vector<Eigen::Vector3d> outline = config.board.outline();
  const std::vector<Candidate> tries = candidates(config.board, search);
  Inverse inverse(config.arm.start_q, config.limits.joint_margin_rad);

  const auto cornersInCell = [&](const Pose<Color, Board>& cMo, int column, int row) {
    int inside = 0;
    for (const Eigen::Vector3d& corner : corners) {
      const auto pixel = model.project(cMo * corner);
      if (!pixel || !model.contains(*pixel)) return 0;
      // Pixel (0,0) is a centre: the image begins half a pixel before.
      inside += static_cast<int>((pixel->x() + 0.5) / cell_width) == column &&
                static_cast<int>((pixel->y() + 0.5) / cell_height) == row;
    }
    return inside;
  };

  ReachableCells result;
  result.cells_x = config.coverage.cells_x;
  result.cells_y = config.coverage.cells_y;
  for (int row = 0; row < result.cells_y; ++row) {
    for (int column = 0; column < result.cells_x; ++column) {
      std::optional<FillingView> found;
      const auto ray =
          model.unproject({(column + 0.5) * cell_width - 0.5, (row + 0.5) * cell_height - 0.5});
      for (const Candidate& candidate : tries) {
        if (!ray || found) break;
        const Eigen::Vector3d centre_ray(ray->x(), ray->y(), 1.0);
        const Pose<Color, Board> cMo(candidate.rotation, centre_ray * candidate.distance_m -
                                                             candidate.rotation * candidate.anchor_o);
        const int inside = cornersInCell(cMo, column, row);
        if (inside < config.coverage.corners_per_cell) continue;
        const Pose<Base, Board> bMo = bMc * cMo;
        const Pose<Base, EndEffector> bMe = bMo * oMe;
        bool allowed = boxesAllow(config.limits, bMe.translation());
        for (const Eigen::Vector3d& point : outline) allowed &= boxesAllow(config.limits, bMo * point);
        if (!allowed) continue;
        if (const auto q = inverse.solve(bMe.isometry())) found = FillingView{cMo, *q, inside};
      }
      result.cells.push_back(found);
    }
  }
  return result;
}

}  // namespace servocal::test
