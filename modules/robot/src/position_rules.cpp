// SPDX-License-Identifier: GPL-3.0-or-later
#include "position_rules.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "link_watch.h"

namespace servocal::robot {
namespace {

constexpr double kGridM = 0.04;        // Between points of the board.
constexpr double kPathStepM = 0.008;   // Between looks along a path, for the fastest point,
constexpr double kPathStepRad = 0.03;  // and for the rotation.
constexpr double kPathStepJointRad = 0.02;
constexpr double kSingular = 0.02;     // Smallest singular value of the Jacobian (m and rad mixed).
constexpr double kSingularShare = 0.25;  // Of the smallest singular value: a step that changes it by no more,
constexpr double kLeastRoom = 0.05;      // times the share of the joint speed limit that is left, at least this.
constexpr double kLeastStepJointRad = 1e-5;
constexpr double kSlackM = 1e-9;
constexpr double kSlackRad = 1e-9;

std::string format(const char* text, double a, double b = 0.0, double c = 0.0) {
  char buffer[160];
  std::snprintf(buffer, sizeof buffer, text, a, b, c);
  return buffer;
}

// How far inside the box a ball is, m; negative outside.
double depthInside(const Box& box, const Eigen::Vector3d& center, double radius) {
  const Eigen::Vector3d outside = (box.min_m - center).cwiseMax(center - box.max_m);
  const double inside = -outside.maxCoeff();
  if (inside >= 0.0) return inside + radius;
  return radius - outside.cwiseMax(0.0).norm();
}

// How far a ball reaches out of the box, m; negative inside.
double depthOutside(const Box& box, const Eigen::Vector3d& center, double radius) {
  return (box.min_m - center).cwiseMax(center - box.max_m).maxCoeff() + radius;
}

// The flange pose after following a constant twist (of the flange's origin, base axes) for `time`.
Pose<Base, EndEffector> followed(const Pose<Base, EndEffector>& bMe, const Twist<Base>& twist,
                                 double time) {
  const auto turn = Pose<Base, Base>::fromRotationVector(time * twist.angular_radps, Eigen::Vector3d::Zero());
  return {turn.rotation() * bMe.rotation(), bMe.translation() + time * twist.linear_mps};
}

}  // namespace

// Rows: flange, then the body's points. Columns: workspace, then each keep-out box and each obstacle. Positive:
// violated, m.
struct PositionRules::Depths {
  Eigen::MatrixXd value;
  std::vector<Eigen::Vector3d> points_b;
};

PositionRules::PositionRules(const Kinematics& kinematics, const MotionLimits& limits,
                             const BoardSpec& board, const GuardOptions& options, std::optional<CollisionModel> links)
    : kinematics_(kinematics), limits_(limits), board_(board), link_clearance_m_(options.link_clearance_m),
      links_(std::move(links)) {
  body_.radius_m = options.unknown_board_radius_m;
}

void PositionRules::setObstacles(const std::vector<Sphere>& obstacles) {
  if (links_) links_->setObstacles(obstacles);
  obstacles_ = obstacles;
}

void PositionRules::setBoard(const std::optional<Pose<EndEffector, Board>>& eMo) {
  body_ = {};
  if (links_) links_->setBoard(eMo);
  if (!eMo) return;
  const std::vector<Eigen::Vector3d> outline = board_.outline();
  for (const Eigen::Vector3d& corner_o : outline) body_.outline_e.push_back(*eMo * corner_o);
  // The plate is a rectangle: a grid between opposite sides.
  const Eigen::Vector3d along_x = outline[1] - outline[0], along_y = outline[3] - outline[0];
  const int steps_x = static_cast<int>(std::ceil(along_x.norm() / kGridM));
  const int steps_y = static_cast<int>(std::ceil(along_y.norm() / kGridM));
  for (int y = 0; y <= steps_y; ++y)
    for (int x = 0; x <= steps_x; ++x)
      body_.points_e.push_back(*eMo * Eigen::Vector3d(outline[0] + along_x * x / steps_x +
                                                      along_y * y / steps_y));
}

PositionRules::Depths PositionRules::depths(const Pose<Base, EndEffector>& bMe) const {
  Depths result;
  result.points_b.push_back(bMe.translation());
  for (const Eigen::Vector3d& point_e : body_.points_e) result.points_b.push_back(bMe * point_e);
  result.value.resize(static_cast<Eigen::Index>(result.points_b.size()),
                      static_cast<Eigen::Index>(1 + limits_.keep_out.size() + obstacles_.size()));
  for (Eigen::Index row = 0; row < result.value.rows(); ++row) {
    const Eigen::Vector3d& point = result.points_b[static_cast<std::size_t>(row)];
    const double radius = row == 0 ? body_.radius_m : 0.0;
    result.value(row, 0) = depthOutside(limits_.workspace, point, radius);
    Eigen::Index column = 0;
    for (const Box& box : limits_.keep_out) result.value(row, ++column) = depthInside(box, point, radius);
    for (const Sphere& obstacle : obstacles_)
      result.value(row, ++column) = obstacle.radius_m + radius - (point - obstacle.center_b).norm();
  }
  return result;
}

Objection PositionRules::boxObjection(const Depths& found, Eigen::Index column, double room_m) const {
  Eigen::Index row = 0;
  const double depth = found.value.col(column).maxCoeff(&row) + room_m;
  const std::string who = row > 0 ? "The board" : body_.radius_m > 0.0 ? "The space kept around the flange"
                                                                       : "The flange";
  const std::string by = format(" by %.0f mm.", std::ceil(1000.0 * depth));
  if (column == 0) return {GuardRule::kWorkspace, who + " would leave the workspace" + by};
  const std::size_t box = static_cast<std::size_t>(column - 1);
  if (box < limits_.keep_out.size())
    return {GuardRule::kKeepOut, who + " would enter the keep-out box '" + limits_.keep_out[box].name + "'" + by};
  return {GuardRule::kKeepOut,
          who + " would come too near to '" + obstacles_[box - limits_.keep_out.size()].name + "'" + by};
}

std::optional<Objection> PositionRules::at(const Pose<Base, EndEffector>& bMe, double room_m) const {
  if (!bMe.isFinite()) return Objection{GuardRule::kNonFinite, "The pose is not a number."};
  const Depths found = depths(bMe);
  for (Eigen::Index column = found.value.cols() - 1; column >= 0; --column)
    if (found.value.col(column).maxCoeff() + room_m > 0.0) return boxObjection(found, column, room_m);
  return std::nullopt;
}

std::optional<Objection> PositionRules::at(const Eigen::VectorXd& q, double room_m) const {
  if (q.size() != kinematics_.joints() || !q.allFinite())
    return Objection{GuardRule::kNonFinite, "The joint angles are not numbers."};
  for (Eigen::Index joint = 0; joint < q.size(); ++joint) {
    const double low = kinematics_.lower()[joint] + limits_.joint_margin_rad;
    const double high = kinematics_.upper()[joint] - limits_.joint_margin_rad;
    if (q[joint] < low || q[joint] > high)
      return Objection{GuardRule::kJoint, format("Joint %.0f would be at %.2f rad, outside its limits.",
                                                 static_cast<double>(joint + 1), q[joint])};
  }
  if (auto found = at(kinematics_.forward(q), room_m)) return found;
  if (!links_) return std::nullopt;
  return linkObjection(links_->gaps(q), link_clearance_m_ + room_m);
}

std::optional<Objection> PositionRules::jointObjection(const Eigen::VectorXd& q, const Eigen::VectorXd& start) const {
  for (Eigen::Index joint = 0; joint < q.size(); ++joint) {
    const double low = kinematics_.lower()[joint] + limits_.joint_margin_rad;
    const double high = kinematics_.upper()[joint] - limits_.joint_margin_rad;
    const double out = std::max(low - q[joint], q[joint] - high);
    const double out_at_start = std::max(low - start[joint], start[joint] - high);
    if (out > std::max(0.0, out_at_start) + kSlackRad)
      return Objection{GuardRule::kJoint, format("Joint %.0f would come to %.2f rad, too near its limit.",
                                                 static_cast<double>(joint + 1), q[joint])};
  }
  return std::nullopt;
}

// Already inside: only the way out, at every step, and not sideways through whatever is there.
std::optional<Objection> PositionRules::boxObjection(const Depths& start, const Depths& before,
                                                     const Depths& here) const {
  for (Eigen::Index column = here.value.cols() - 1; column >= 0; --column) {
    for (Eigen::Index row = 0; row < here.value.rows(); ++row) {
      const double depth = here.value(row, column);
      if (depth <= 0.0) continue;
      const std::size_t point = static_cast<std::size_t>(row);
      const double moved = (here.points_b[point] - before.points_b[point]).norm();
      if (start.value(row, column) > 0.0 && depth <= before.value(row, column) - 0.2 * moved + kSlackM) continue;
      return boxObjection(here, column);
    }
  }
  return std::nullopt;
}

std::optional<Objection> PositionRules::along(const RobotState& state, const Motion& motion, double hold_s,
                                              double reach_rad) const {
  if (motion.isZero()) return std::nullopt;
  const bool by_twist = motion.kind == Motion::Kind::kTwist;
  double lever = body_.radius_m;
  for (const Eigen::Vector3d& point_e : body_.outline_e) lever = std::max(lever, point_e.norm());
  // The arm's own report and the nominal kinematics differ by a little that stays.
  Pose<EndEffector, EndEffector> difference = Pose<EndEffector, EndEffector>::identity();
  if (!by_twist) difference = kinematics_.forward(state.q).inverse() * state.bMe;

  const Depths start = depths(state.bMe);
  Depths before = start;
  std::optional<LinkWatch> links;
  if (links_) links.emplace(*links_, state.q, link_clearance_m_);
  Eigen::VectorXd q = state.q;
  double singularity = std::numeric_limits<double>::infinity();
  double brake_s = 0.0;
  double length_s = hold_s;
  for (double from_s = 0.0, to_s = 0.0; from_s < length_s; from_s = to_s) {
    const MotionAt here(kinematics_.jacobian(q));
    const Twist<Base> twist = here.twist(motion);
    const Eigen::VectorXd speeds = here.joints(motion);
    if (!speeds.allFinite()) return Objection{GuardRule::kJoint, "The arm would come to a singular pose."};
    // Braking at a constant rate covers half of what the full speed would in the same time. Joints keep
    // their direction while the twist they make, and with it the time, may grow along the way.
    brake_s = std::max(brake_s, here.brakingTime(motion, limits_));
    length_s = hold_s + 0.5 * brake_s;
    // Share of the motion that is left there while braking.
    const double left = from_s <= hold_s ? 1.0 : std::sqrt(std::max(0.0, (length_s - from_s) / (0.5 * brake_s)));
    if (by_twist) {
      // No way through a singularity, however short: joints flip there between two looks.
      const double before_singularity = singularity;
      singularity = here.smallestSingularValue();
      if (singularity < kSingular && singularity < before_singularity * (1.0 - 1e-6) && from_s > 0.0)
        return Objection{GuardRule::kJoint, "The arm would come to a singular pose."};
    }
    Eigen::Index fastest_joint = 0;
    const double fastest_radps = speeds.cwiseAbs().maxCoeff(&fastest_joint);
    const double use = left * fastest_radps * here.speedMargin(motion, reach_rad) / limits_.max_joint_speed_radps;
    if (use > 1.0 + 1e-6)
      return Objection{GuardRule::kJointSpeed, format("Joint %.0f would have to race, so near is a singular pose.",
                                                      static_cast<double>(fastest_joint + 1))};
    // Joints by small steps along the Jacobian: near a singularity its change is what matters. No step may lead
    // across, where it would look like the way out, nor past a place where a joint is too fast.
    double step_rad = kPathStepJointRad;
    if (by_twist)
      step_rad = std::clamp(kSingularShare * singularity * std::max(1.0 - use, kLeastRoom), kLeastStepJointRad, step_rad);
    const double turning = twist.angular_radps.norm();
    const double fastest = twist.linear_mps.norm() + turning * lever;
    const double step_s = 1.0 / std::max({2.0 / length_s, fastest / kPathStepM, turning / kPathStepRad,
                                          fastest_radps / step_rad});
    to_s = from_s + step_s > length_s * (1.0 - 1e-6) ? length_s : from_s + step_s;
    q += (to_s - from_s) * speeds;
    if (auto found = jointObjection(q, state.q)) return found;

    const Pose<Base, EndEffector> bMe =
        by_twist ? followed(state.bMe, twist, to_s) : kinematics_.forward(q) * difference;
    const Twist<Base> there = by_twist ? twist : MotionAt(kinematics_.jacobian(q)).twist(motion);
    if (left * speedUse(there, bMe.rotation(), body_, limits_) > 1.0 + 1e-6)
      return Objection{GuardRule::kSpeed, "The turning board would become too fast."};
    Depths depths_here = depths(bMe);
    if (auto found = boxObjection(start, before, depths_here)) return found;
    before = std::move(depths_here);
    if (links) {
      if (auto found = links->moveTo(q, to_s >= length_s)) return found;
    }
  }
  return std::nullopt;
}

}  // namespace servocal::robot
